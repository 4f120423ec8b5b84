"""Pieces of the search's work: random starts of some families, and gaits led to other speeds."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from rimless_gym.params import WheelParams
from scripts.studies.fronts.cells import Attempt, Found, Place
from trajopt.gaits.periodic import BARRIER
from trajopt.gaits.problem import CONTROL_DEGREE, gait_problem, posed
from trajopt.gaits.search import SEARCH_DEGREE, SEARCH_ELEMENTS, random_motion
from trajopt.gaits.stability import floquet_multipliers
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Problem
from trajopt.ocp.solve import WARM_BARRIER, minimize
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.ocp.transcription import Result, Transcription, interruptible

#: Longest element of the search's mesh (s), as far as the largest mesh allows; elements per step.
#: Longer elements step over the kinks of dry friction and make slow walks look too cheap.
ELEMENT_TIME, MESHES = 0.05, (SEARCH_ELEMENTS, 20, 30, 40, 55, 75, 100)

#: A gait whose deviations grow by more in a stride is not counted: rounding alone would make its
#: simulation miss the tolerance of its verification. Such gaits stand on one leg for seconds.
MOST_GROWTH = 1e7

#: Times that a gait is solved again on a finer mesh, because a step became longer.
REMESHED = 2

#: Iterations of IPOPT at most: for each of a random start's two problems, if the pendulum swings
#: and if it turns over, and for a gait that is led. More seldom lead anywhere.
SWING_ITERATIONS, WHIRL_ITERATIONS, LED_ITERATIONS = 250, 120, 100


class Family(NamedTuple):
    """Random starts with so many turns per stride: `starts` of them from number `first`."""

    turns: int
    first: int
    starts: int


class Screen(NamedTuple):
    """Random starts in families.

    Attributes:
        place: where.
        families: tried in this order.
        outwards: whether to stop at the first family whose first start becomes no gait.
    """

    place: Place
    families: tuple[Family, ...]
    outwards: bool = False


class Lead(NamedTuple):
    """A gait to be led to another speed."""

    place: Place
    gait: Found


class Join(NamedTuple):
    """One-step gaits of several speeds, to be joined to a stride; one for every step."""

    place: Place
    parts: tuple[Found, ...]

    @property
    def key(self) -> str:
        """Tells joints apart."""
        return " + ".join(part.key for part in self.parts)


class Timed(Protocol):
    """A phase of a guess or of a solution."""

    @property
    def duration(self) -> float:
        """Its time (s)."""


Piece: TypeAlias = Screen | Lead | Join


def elements_for(phases: Sequence[Timed], duration: float) -> tuple[int, ...]:
    """Elements of every step on the search's mesh, for steps whose times add up to a duration."""
    scale = duration / sum(phase.duration for phase in phases)
    return tuple(_elements(scale * phase.duration) for phase in phases)


def _elements(time_of_step: float) -> int:
    return next((n for n in MESHES if time_of_step <= n * ELEMENT_TIME), MESHES[-1])


def attempts(params: WheelParams, piece: Piece) -> list[Attempt]:
    """Do a piece of work."""
    if isinstance(piece, Lead):
        return [led(params, piece)]
    if isinstance(piece, Join):
        return [joined(params, piece)]
    made: list[Attempt] = []
    for turns, first, starts in piece.families:
        for index in range(first, first + starts):
            made.append(started(params, piece.place, turns, index))
            hopeless = turns != 0 and index == 0 and made[-1].found is None
            if hopeless and piece.outwards:
                return made
            if hopeless:
                break
    return made


def started(params: WheelParams, place: Place, turns: int, index: int) -> Attempt:
    """A random start, solved with regeneration first, where the landscape is smoother."""
    begin = time.process_time()
    label = f"seed {place.seed}, random start {index} at {place.speed:g} m/s"
    numbers = [place.seed, round(1e4 * place.speed), place.steps, turns + 1000, index]
    rng = np.random.default_rng(numbers)
    duration = place.steps * params.step_length / place.speed
    guess = random_motion(params, place.steps, duration, turns, rng)
    result: Result | None = None
    most = WHIRL_ITERATIONS if turns else SWING_ITERATIONS
    for regeneration in (True, False):
        result = _solved(params, place, turns, guess, regeneration, max_iter=most)
        if not result.success:
            break
        guess = result.phases
    assert result is not None
    found = _found(params, place, turns, result, label)
    return Attempt(turns, label, False, found, time.process_time() - begin)


def led(params: WheelParams, piece: Lead) -> Attempt:
    """A gait led to another speed at once, or else in two steps."""
    begin, (place, gait) = time.process_time(), piece
    halfway = place._replace(speed=(gait.speed + place.speed) / 2)
    options = {"mu_init": BARRIER, "max_iter": LED_ITERATIONS}
    result = _solved(params, place, gait.turns, gait.phases, False, **options)
    if not result.success:
        between = _solved(params, halfway, gait.turns, gait.phases, False, **options)
        if between.success:
            result = _solved(params, place, gait.turns, between.phases, False, **options)
    label = f"{gait.origin.split('; ')[0]}; led from {gait.speed:g} m/s"
    found = _found(params, place, gait.turns, result, label)
    return Attempt(gait.turns, gait.key, True, found, time.process_time() - begin)


def joined(params: WheelParams, piece: Join) -> Attempt:
    """One-step gaits joined to a stride: the pendulum goes on from step to step."""
    begin, (place, parts) = time.process_time(), piece
    phases, turns = [], 0
    for part in parts:
        turned = np.array([0.0, 2 * math.pi * turns, 0.0, 0.0])
        phases += [dataclasses.replace(p, states=p.states + turned) for p in part.phases]
        turns += part.turns
    result = _solved(params, place, turns, phases, False, max_iter=WHIRL_ITERATIONS)
    speeds = ", ".join(f"{part.speed:g}" for part in parts)
    label = f"{parts[0].origin.split('; ')[0]}; steps of {speeds} m/s joined"
    found = _found(params, place, turns, result, label)
    return Attempt(turns, piece.key, True, found, time.process_time() - begin)


def _found(
    params: WheelParams, place: Place, turns: int, result: Result, origin: str
) -> Found | None:
    if not result.success or _growth(params, result.phases) > MOST_GROWTH:
        return None
    cot = result.cost / (params.weight * place.steps * params.step_length)
    return Found(place.speed, turns, cot, _plain(result.phases), origin)


def _growth(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> float:
    """The factor by which a deviation grows in a stride."""
    return float(np.abs(floquet_multipliers(params, phases)).max())


def _plain(phases: Sequence[PhaseTrajectory]) -> tuple[PhaseTrajectory, ...]:
    """Phases whose arrays are their own, so that files and other processes get nothing else."""
    return tuple(
        dataclasses.replace(p, states=p.states.copy(), controls=p.controls.copy()) for p in phases
    )


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

    Too coarse a mesh would make a gait look cheaper than it is.
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
        options = {"mu_init": WARM_BARRIER, "max_iter": LED_ITERATIONS}
    return result


@lru_cache(maxsize=64)
def _transcription(params: WheelParams, elements: tuple[int, ...]) -> tuple[Problem, Transcription]:
    """The problem and its transcription on a mesh; every process makes its own once."""
    problem = gait_problem(params, speed=1.0, steps=len(elements))
    mesh = Mesh.uniform(problem, elements, SEARCH_DEGREE, control_degree=CONTROL_DEGREE)
    return problem, Transcription(problem, mesh)
