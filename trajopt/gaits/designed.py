"""Gaits of least cost of transport, with parameters of the machine chosen too."""

from __future__ import annotations

import dataclasses
from typing import Any

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import Design
from trajopt.gaits.stance import WheelPhases
from trajopt.ocp.constraints import Bounds
from trajopt.ocp.problem import Problem


def designed_gait(
    params: WheelParams,
    design: Design,
    bounds: Bounds,
    *,
    steps: int,
    duration: float | tuple[float, float],
    theta_turns: int = 0,
) -> Problem:
    """The problem of a periodic gait of least E+ per weight and distance, and of its machine.

    Args:
        params: the machine, apart from what is to be chosen.
        design: what is to be chosen: the problem's static parameters.
        bounds: on the static parameters, by name.
        steps: touchdowns per stride.
        duration: of a stride (s), or bounds on it.
        theta_turns: whole turns that theta gains in a stride.
    """
    wheel = WheelPhases(params, design)
    power, weight = wheel.of("electrical_power"), wheel.of("weight")
    distance = steps * params.step_length

    def per_weight_and_distance(x: Any, u: Any, p: Any) -> Any:
        return power(x, u, p) / (weight(x, p) * distance)

    def idle(x: Any, u: Any, p: Any) -> Any:
        return params.idle_power / (weight(x, p) * distance)

    stance = dataclasses.replace(
        wheel.single_stance(),
        powers=per_weight_and_distance,
        floor=0.0,
        cost=idle if params.idle_power else None,
    )
    links = [wheel.touchdown(i, i + 1) for i in range(steps - 1)]
    links.append(wheel.touchdown(steps - 1, 0, theta_turns))
    return Problem((stance,) * steps, tuple(links), parameters=bounds, duration=duration)
