"""Continue shipped strides to other speeds, with longer or shorter rests, and ship them.

With its pendulum hanging still, a wheel can balance upright on one leg at its idle power. A stride
that comes near this rest is continued to slower speeds: it rests longer, and the steps around the
rest hardly change. At faster speeds it rests shorter.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from agents.cli.options import Count, Preset
from rimless_gym.params import WheelParams
from rimless_gym.presets import as_params
from scripts.studies.fronts.command import LONG, WINDOWS, chosen, publish, ship
from scripts.studies.fronts.solving import Joint, Place, SearchGait, joined, polish
from scripts.studies.stages import gaits_of, stage
from trajopt.gaits.finish import finished
from trajopt.gaits.fronts import CotFront, shipped_front
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

#: A gait is continued to a speed if it is expected to save this share of the cost there.
WORTH = 0.01

#: IPOPT's first barrier: a larger one drives long strides to other optima.
BARRIER = 1e-6


def rests(
    *, preset: Preset = "BUILDABLE", workers: Count | None = None, out: Path = Path("runs/rests")
) -> int:
    """Continue shipped strides to the speeds of a machine's front, and ship what costs less.

    Args:
        preset: machine, on level ground.
        workers: processes; by default one for every core.
        out: folder of the search.
    """
    params = as_params(preset)
    gaits = [gait for gait in shipped(params) if not gait.regeneration]
    front = shipped_front(params).envelope
    best = min(front, key=lambda gait: gait.cot)
    speeds = [round(gait.speed, 4) for gait in front if gait.speed < best.speed]
    with Store(out / preset, {"params": params.to_dict()}) as store:
        joints = {f"{steps}_steps": (params, joint) for steps, joint in first_rests(gaits, best)}
        gaits += gaits_of(stage(store, "joined", joints, joined_rest, workers)).values()
        done = set[str]()
        for most in reversed(WINDOWS):
            while tasks := dict(continuations(gaits, most, speeds, done)):
                found = stage(store, "rests", tasks, continued_to, workers)
                gaits += gaits_of(found).values()
                done |= found.keys()
    ship(ARCHIVE, preset, chosen(gaits))
    publish(preset)
    return 0


def first_rests(gaits: Sequence[Solution], best: Solution) -> Iterator[tuple[int, Joint]]:
    """For windows without a stride that rests, a step that rests joined to steps of least cost."""
    resting = [gait for gait in gaits if distance_to_rest(gait.phases)[0] < NEAR_REST]
    slow = min(resting, key=_work, default=best)
    for steps in WINDOWS:
        if slow.steps < steps and not any(gait.steps == steps for gait in resting):
            parts = [slow, *[best] * ((steps - slow.steps) // best.steps)]
            duration = sum(part.duration for part in parts)
            speed = steps * best.params.step_length / duration
            yield steps, Joint(Place(0, speed, steps), tuple(map(_part, parts)))


def _work(gait: Solution) -> float:
    """The energy beside the idle power (J)."""
    return gait.cost - gait.params.idle_power * gait.duration


def _part(gait: Solution) -> SearchGait:
    return SearchGait(gait.speed, gait.theta_turns, gait.cot, gait.phases, "shipped")


def joined_rest(params: WheelParams, joint: Joint) -> Solution | str:
    """A joined stride, solved and verified; or why there is none."""
    gait = joined(params, joint).gait
    return polish(params, gait) if gait else "no gait on the search's mesh"


def continuations(
    gaits: Iterable[Solution], most: int, speeds: Sequence[float], done: set[str]
) -> Iterator[tuple[str, tuple[Solution, float]]]:
    """Strides of up to so many steps that should cost less than others at the next speed.

    They rest or are long. A gait's work beside the idle power should stay what it is.
    """
    front = CotFront(tuple(g for g in gaits if g.steps <= most and not g.double_stance)).envelope
    best = {round(gait.speed, 4): gait for gait in front}
    pairs = [pair for each in pairwise(speeds) for pair in (each, each[::-1])]
    for gait, speed in [(best[there], speed) for there, speed in pairs if there in best]:
        idle = gait.params.idle_power / gait.params.weight
        expected = gait.cot + idle * (1 / speed - 1 / gait.speed)
        least = best[speed].cot if speed in best else math.inf
        key = f"{gait.steps}_steps_k{gait.theta_turns}_{gait.speed:.4f}_{gait.cot:.6g}_{speed:.4f}"
        saves = expected < (1 - WORTH) * least and key not in done
        if saves and (gait.steps >= LONG or distance_to_rest(gait.phases)[0] < NEAR_REST):
            yield key, (gait, speed)


def continued_to(gait: Solution, speed: float) -> Solution | str:
    """A gait continued to another speed, at which it rests longer or shorter; or why there is none.

    Near enough to the rest, the longer one is the optimum. Otherwise it is the guess.
    """
    params, turns, phases = gait.params, gait.theta_turns, gait.phases
    longer = gait.steps * params.step_length / speed - gait.duration
    settings = {"speed": speed, "found_by": f"{gait.speed:.4f} m/s, continued"}
    if distance_to_rest(phases)[0] < NEAR_REST:
        phases = resting_longer(phases, longer) if longer > 0 else resting_shorter(phases, -longer)
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
    extremal = solve(
        problem, phases, mesh, verify=False, mu_init=BARRIER, passes=1, option_sets=({},)
    )
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


def resting_shorter(
    phases: Sequence[PhaseTrajectory], shorter: float
) -> tuple[PhaseTrajectory, ...]:
    """The phases without the elements that lie within a duration (s) around the nearest to rest."""
    _, i, e = distance_to_rest(phases)
    phase = phases[i]
    middle = (phase.edges[:-1] + phase.edges[1:]) / 2
    left = np.abs(middle - phase.edges[e]) > shorter / 2
    changed = dataclasses.replace(
        phase,
        edges=np.concatenate([[0.0], np.cumsum(np.diff(phase.edges)[left])]),
        states=phase.states[left],
        controls=phase.controls[left],
    )
    return (*phases[:i], changed, *phases[i + 1 :])
