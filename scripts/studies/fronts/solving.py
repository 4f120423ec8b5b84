"""The tasks of a search: random starts, gaits continued to other speeds, steps joined to strides.

A task is solved on the search's mesh by `attempts`; `polish` solves a gait on a fine mesh and
verifies it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from rimless_gym.params import WheelParams
from trajopt.gaits.finish import finished
from trajopt.gaits.periodic import BARRIER, DEGREE, ELEMENTS
from trajopt.gaits.problem import CONTROL_DEGREE, gait_problem, posed
from trajopt.gaits.search import SEARCH_DEGREE, SEARCH_ELEMENTS, random_motion
from trajopt.gaits.solution import Solution
from trajopt.gaits.verify import floquet_multipliers
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Problem
from trajopt.ocp.solve import WARM_BARRIER, minimize, solve
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.ocp.transcription import Result, Transcription, interruptible

#: Longest element of the search's mesh (s), as far as the largest mesh allows; elements per step.
#: Longer elements step over the kinks of dry friction and make the cost of slow walks look too low.
ELEMENT_TIME, MESHES = 0.05, (SEARCH_ELEMENTS, 20, 30, 40, 55, 75, 100)

#: A gait whose deviations grow by more per step does not count: it stands on one leg for seconds,
#: which `rests` does better.
MOST_GROWTH = 1e7

#: Times that a gait is solved again on a finer mesh, because a step became longer.
REMESHED = 2

#: Iterations of IPOPT at most: for each of a random start's two problems, if the pendulum swings
#: and if it turns over, and for a continued gait. More rarely help.
SWING_ITERATIONS, WHIRL_ITERATIONS, CONTINUED_ITERATIONS = 250, 120, 100

#: Gaits of one family are the same if their costs of transport differ by less (relative).
SAME_COT = 1e-4

#: Refinements of the fine mesh at most and their tolerance: at first, and where the gait then fails
#: its verification.
REFINED: tuple[dict[str, Any], ...] = ({"passes": 4}, {"passes": 6, "tolerance": 1e-9})


@dataclasses.dataclass(frozen=True)
class SearchGait:
    """A gait on the search's mesh."""

    speed: float  # m/s
    turns: int  # whole turns of the pendulum in a stride
    cot: float  # cost of transport (E+)
    phases: tuple[PhaseTrajectory, ...] = dataclasses.field(repr=False, compare=False)  # of steps
    origin: str = ""  # how it was found, in words

    @property
    def steps(self) -> int:
        """Per stride."""
        return len(self.phases)

    @property
    def key(self) -> str:
        """Identifies the gait."""
        return f"{self.steps}_steps_k{self.turns}_{self.speed:.4f}_{self.cot:.6g}"

    def same_as(self, other: SearchGait) -> bool:
        """Whether both are one gait of one speed and number of steps."""
        return self.turns == other.turns and math.isclose(self.cot, other.cot, rel_tol=SAME_COT)


class Place(NamedTuple):
    """Seed of the search, speed (m/s), and steps per stride."""

    seed: int
    speed: float
    steps: int


class RandomStarts(NamedTuple):
    """Random starts in families of turns per stride."""

    place: Place
    # (turns, number of the first start, how many starts), tried in this order
    families: tuple[tuple[int, int, int], ...]
    outwards: bool = False  # whether the first family whose first start becomes no gait is the last


class Continuation(NamedTuple):
    """A gait to be continued to another speed."""

    place: Place
    gait: SearchGait

    @property
    def key(self) -> str:
        """Identifies the gait."""
        return self.gait.key


class Joint(NamedTuple):
    """One-step gaits of several speeds, to be joined to a stride; one for every step."""

    place: Place
    parts: tuple[SearchGait, ...]

    @property
    def key(self) -> str:
        """Identifies the parts."""
        return " + ".join(part.key for part in self.parts)


Task: TypeAlias = RandomStarts | Continuation | Joint


class SolveAttempt(NamedTuple):
    """A solve, and its result."""

    turns: int  # of the family
    known: str | None  # the key of what was continued or joined; None for a random start
    gait: SearchGait | None  # if there is one


def attempts(params: WheelParams, task: Task) -> list[SolveAttempt]:
    """Solve a task."""
    if isinstance(task, Continuation):
        return [continued(params, task)]
    if isinstance(task, Joint):
        return [joined(params, task)]
    made: list[SolveAttempt] = []
    for turns, first, starts in task.families:
        for index in range(first, first + starts):
            made.append(started(params, task.place, turns, index))
            hopeless = turns != 0 and index == 0 and made[-1].gait is None
            if hopeless and task.outwards:
                return made
            if hopeless:
                break
    return made


def started(params: WheelParams, place: Place, turns: int, index: int) -> SolveAttempt:
    """A random start, solved with regeneration first, where the landscape is smoother."""
    label = f"seed {place.seed}, random start {index} at {place.speed:g} m/s"
    numbers = [place.seed, round(1e4 * place.speed), place.steps, turns + 1000, index]
    rng = np.random.default_rng(numbers)
    duration = place.steps * params.step_length / place.speed
    guess = random_motion(params, place.steps, duration, turns, rng)
    most = WHIRL_ITERATIONS if turns else SWING_ITERATIONS
    result = _solved(params, place, turns, guess, True, max_iter=most)
    if result.success:
        result = _solved(params, place, turns, result.phases, False, max_iter=most)
    return SolveAttempt(turns, None, _gait(params, place, turns, result, label))


def continued(params: WheelParams, task: Continuation) -> SolveAttempt:
    """A gait continued to another speed at once, or else in two steps."""
    place, gait = task
    halfway = place._replace(speed=(gait.speed + place.speed) / 2)
    options = {"mu_init": BARRIER, "max_iter": CONTINUED_ITERATIONS}
    result = _solved(params, place, gait.turns, gait.phases, False, **options)
    if not result.success:
        between = _solved(params, halfway, gait.turns, gait.phases, False, **options)
        if between.success:
            result = _solved(params, place, gait.turns, between.phases, False, **options)
    label = f"{gait.origin.split('; ')[0]}; continued from {gait.speed:g} m/s"
    return SolveAttempt(gait.turns, task.key, _gait(params, place, gait.turns, result, label))


def joined(params: WheelParams, task: Joint) -> SolveAttempt:
    """One-step gaits joined to a stride: the pendulum goes on from step to step."""
    place, parts = task
    phases, turns = [], 0
    for part in parts:
        turned = np.array([0.0, 2 * math.pi * turns, 0.0, 0.0])
        phases += [dataclasses.replace(p, states=p.states + turned) for p in part.phases]
        turns += part.turns
    result = _solved(params, place, turns, phases, False, max_iter=WHIRL_ITERATIONS)
    speeds = ", ".join(f"{part.speed:g}" for part in parts)
    label = f"{parts[0].origin.split('; ')[0]}; steps of {speeds} m/s joined"
    return SolveAttempt(turns, task.key, _gait(params, place, turns, result, label))


def _gait(
    params: WheelParams, place: Place, turns: int, result: Result, origin: str
) -> SearchGait | None:
    if not result.success:
        return None
    growth = np.abs(floquet_multipliers(params, result.phases)).max()
    if growth > MOST_GROWTH**place.steps:
        return None
    cot = result.cost / (params.weight * place.steps * params.step_length)
    phases = tuple(  # copies, so that files and other processes get nothing but these arrays
        dataclasses.replace(p, states=p.states.copy(), controls=p.controls.copy())
        for p in result.phases
    )
    return SearchGait(place.speed, turns, cot, phases, origin)


@interruptible()
def _solved(
    params: WheelParams,
    place: Place,
    turns: int,
    guess: Sequence[PhaseTrajectory],
    regeneration: bool,
    **options: float,
) -> Result:
    """A local optimum near a guess, on a mesh that suits the guess's steps, or its own if longer.

    Too coarse a mesh would make a gait's cost look too low.
    """
    duration = place.steps * params.step_length / place.speed
    elements = elements_for(guess, duration)
    for _ in range(REMESHED + 1):
        first, transcription = _transcription(params, elements)
        problem = posed(first, params, place.speed, turns, regeneration)
        result = minimize(transcription, guess, problem, None, **options)
        if not result.success or not math.isfinite(result.cost):
            return dataclasses.replace(result, success=False)
        needed, guess = elements_for(result.phases, duration), result.phases
        if all(have >= need for have, need in zip(elements, needed, strict=True)):
            break
        elements = tuple(max(pair) for pair in zip(elements, needed, strict=True))
        options = {"mu_init": WARM_BARRIER, "max_iter": CONTINUED_ITERATIONS}
    return result


def elements_for(phases: Sequence[PhaseTrajectory], duration: float) -> tuple[int, ...]:
    """Elements of every step on the search's mesh, for steps whose times add up to a duration."""
    scale = duration / sum(phase.duration for phase in phases)
    times = [scale * phase.duration for phase in phases]
    return tuple(next((n for n in MESHES if t <= n * ELEMENT_TIME), MESHES[-1]) for t in times)


@lru_cache(maxsize=64)
def _transcription(params: WheelParams, elements: tuple[int, ...]) -> tuple[Problem, Transcription]:
    """The problem and its transcription on a mesh; every process makes its own once."""
    problem = gait_problem(params, speed=1.0, steps=len(elements))
    mesh = Mesh.uniform(problem, elements, SEARCH_DEGREE, control_degree=CONTROL_DEGREE)
    return problem, Transcription(problem, mesh)


# -- fine meshes ----------------------------------------------------------------------------------


def polish(params: WheelParams, gait: SearchGait) -> Solution | str:
    """One gait solved finely and verified, or why it fails."""
    problem = gait_problem(params, speed=gait.speed, steps=gait.steps, theta_turns=gait.turns)
    duration = gait.steps * params.step_length / gait.speed
    elements = [max(ELEMENTS, n) for n in elements_for(gait.phases, duration)]
    mesh = Mesh.uniform(problem, elements, DEGREE, control_degree=CONTROL_DEGREE)
    settings = {"speed": gait.speed, "found_by": gait.origin}
    phases, failure = gait.phases, ""
    for refined in REFINED:
        extremal = solve(problem, phases, mesh, verify=False, mu_init=WARM_BARRIER, **refined)
        if not extremal.succeeded:
            failure = failure or f"no gait on a fine mesh: {extremal.status}"
            break
        solution = finished(params, extremal, gait.turns, False, settings)
        failure = "; ".join(solution.verification.failures)
        if not failure:
            return solution
        phases, mesh = extremal.phases, extremal.mesh
    return failure
