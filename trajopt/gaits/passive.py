"""A problem with a known answer: the rolling cycle of a bare wheel down a slope."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt.ocp.problem import Linkage, Phase, Problem
from trajopt.ocp.textbook import Example


def passive_wheel(legs: int = 8, slope: float = 0.12) -> Problem:
    """The only cycle of a bare wheel down a slope; the cost is its rate after touchdown (rad/s)."""
    params = _bare_wheel(legs, slope)
    model = HybridModel(params)

    def full(x: Any) -> Any:
        return ca.vertcat(x[0], 0, x[1], 0)

    stance = Phase(
        "stance",
        states=("phi", "dphi"),
        flow=lambda x, u, p: model.flow(full(x), 0.0)[[0, 2]],
        start={"phi": params.constants.a, "dphi": (0.1, 10.0)},
        end={"phi": (params.constants.a, params.constants.a + 2 * params.constants.alpha)},
        duration=(0.05, 5.0),
    )
    return Problem(
        (stance,),
        linkages=(Linkage(0, 0, lambda x, p: model.touchdown(full(x))[[0, 2]]),),
        endpoint_cost=lambda starts, ends, durations, p: starts[0][1],
    )


def passive_wheel_rate(legs: int = 8, slope: float = 0.12) -> float:
    """The cycle's rate after touchdown (rad/s): Tedrake, Underactuated Robotics, "Simple legs"."""
    params, a = _bare_wheel(legs, slope), math.pi / legs
    push = 4 * params.gravity / params.leg_length * math.sin(a) * math.sin(slope)
    return math.sqrt(push) / math.tan(2 * a)


def _bare_wheel(legs: int, slope: float) -> WheelParams:
    return WheelParams(
        n_legs=legs,
        slope=slope,
        wheel_inertia=0.0,
        pendulum_length=0.0,
        pendulum_inertia=0.1,
        motor_constant=0.0,
    )


PASSIVE_WHEEL = Example(passive_wheel, passive_wheel_rate)
