"""Let shipped strides stand longer on one leg, and ship the slower gaits.

With its pendulum hanging still, a wheel can balance upright on one leg at its idle power. A stride
that comes near this rest is continued to slower speeds: it rests longer, and the steps around the
rest hardly change.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from agents.cli.options import Count, Preset
from rimless_gym.params import WheelParams
from rimless_gym.presets import as_params
from scripts.studies.fronts.command import WINDOWS, chosen, publish, ship
from scripts.studies.stages import gaits_of, stage
from trajopt.gaits.finish import finished
from trajopt.gaits.fronts import shipped_front
from trajopt.gaits.library import ARCHIVE, shipped
from trajopt.gaits.problem import CONTROL_DEGREE, gait_problem
from trajopt.gaits.solution import Solution
from trajopt.gaits.verify import verify
from trajopt.ocp.arrays import Array
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.solve import solve
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.store import Store, provenance

#: A stride comes near the rest if at some time no state differs from it by more (rad, rad/s).
NEAR_REST = 0.1

#: Longest element in which the wheel rests (s): deviations grow tenfold in it.
REST_ELEMENT = 0.4

#: IPOPT's first barrier: a larger one drives long strides to other optima.
BARRIER = 1e-6


def rests(
    *, preset: Preset = "BUILDABLE", workers: Count | None = None, out: Path = Path("runs/rests")
) -> int:
    """Continue shipped strides that rest on one leg to slower speeds, and ship them.

    Args:
        preset: machine, on level ground.
        workers: processes; by default one for every core.
        out: folder of the search.
    """
    params = as_params(preset)
    gaits = [gait for gait in shipped(params) if not gait.regeneration]
    last = {gait.steps: gait for gait in bases(gaits)}
    speeds = sorted({round(gait.speed, 4) for gait in shipped_front(params).envelope})
    with Store(out / preset, {"params": params.to_dict()}) as store:
        for speed in reversed(speeds):
            slower = [gait for gait in last.values() if speed < gait.speed - 1e-6]
            tasks = {f"{gait.steps}_steps_{speed:.4f}": (gait, speed) for gait in slower}
            found = gaits_of(stage(store, "rests", tasks, rested, workers)).values()
            last |= {gait.steps: gait for gait in found}
            gaits += found
    ship(ARCHIVE, preset, chosen(gaits))
    publish(preset)
    return 0


def bases(gaits: Iterable[Solution]) -> Iterator[Solution]:
    """Of every window's number of steps, the gait near the rest that works least beside idling."""
    for steps in WINDOWS:
        near = [
            gait
            for gait in gaits
            if gait.steps == steps and distance_to_rest(gait.phases)[0] < NEAR_REST
        ]
        if near:
            yield min(near, key=lambda gait: gait.cost - gait.params.idle_power * gait.duration)


def rested(gait: Solution, speed: float) -> Solution | str:
    """A gait continued to a slower speed, at which it rests longer; or why there is none.

    Near enough to the rest the longer one is the optimum. Otherwise it is the guess.
    """
    params, turns = gait.params, gait.theta_turns
    longer = gait.steps * params.step_length / speed - gait.duration
    phases = resting_longer(gait.phases, longer)
    settings = {"speed": speed, "found_by": f"{gait.speed:.4f} m/s, rested longer"}
    checked = verify(params, phases, turns)
    if checked.passed:
        made: dict[str, Any] = {"verification": checked, "provenance": provenance(**settings)}
        return dataclasses.replace(gait, phases=phases, **made)
    return solved(params, phases, turns, speed, settings)


def solved(
    params: WheelParams,
    phases: Sequence[PhaseTrajectory],
    turns: int,
    speed: float,
    settings: dict[str, object],
) -> Solution | str:
    """A gait solved on its guess's own mesh, refined, and verified; or why there is none."""
    problem = gait_problem(params, speed=speed, steps=len(phases), theta_turns=turns)
    mesh = Mesh(
        tuple(tuple((p.edges / p.duration).tolist()) for p in phases),
        tuple((len(p.nodes) - 1,) * (len(p.edges) - 1) for p in phases),
        control_degree=CONTROL_DEGREE,
    )
    extremal = solve(problem, phases, mesh, verify=False, mu_init=BARRIER, passes=1)
    if not extremal.succeeded:
        return f"no gait on a fine mesh: {extremal.status}"
    gait = finished(params, extremal, turns, False, settings)
    return gait if gait.verification.passed else "; ".join(gait.verification.failures)


def distance_to_rest(phases: Sequence[PhaseTrajectory]) -> tuple[float, int, int]:
    """Least distance of a state at an element's start to the rest; its phase and element."""
    near = [
        (float(np.abs(x - rest(x)).max()), i, e)
        for i, phase in enumerate(phases)
        for e, x in enumerate(phase.states[:, 0])
    ]
    return min(near)


def rest(x: Array) -> Array:
    """The state at rest that is nearest to x: upright, the pendulum hanging, shape (4,)."""
    turns = round(x[1] / (2 * math.pi) - 0.5)
    return np.array([math.pi / 2, math.pi * (2 * turns + 1), 0.0, 0.0])


def resting_longer(phases: Sequence[PhaseTrajectory], longer: float) -> tuple[PhaseTrajectory, ...]:
    """The phases with a rest of a duration (s) where they are nearest to it."""
    _, i, e = distance_to_rest(phases)
    phase, count = phases[i], math.ceil(longer / REST_ELEMENT)
    added = np.broadcast_to(rest(phase.states[e, 0]), (count, *phase.states.shape[1:]))
    idle = np.zeros((count, *phase.controls.shape[1:]))
    times = phase.edges[e] + longer * np.arange(1, count + 1) / count
    edges = [phase.edges[: e + 1], times, phase.edges[e + 1 :] + longer]
    changed = dataclasses.replace(
        phase,
        edges=np.concatenate(edges),
        states=np.concatenate([phase.states[:e], added, phase.states[e:]]),
        controls=np.concatenate([phase.controls[:e], idle, phase.controls[e:]]),
    )
    return (*phases[:i], changed, *phases[i + 1 :])
