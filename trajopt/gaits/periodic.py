"""Periodic gaits of least cost of transport."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any

from rimless_gym.checks import flag, integer, require_kind
from rimless_gym.hybrid import MAX_RATE
from rimless_gym.params import WheelParams
from trajopt.gaits.search import GaitFamily, same_gait, search_gaits
from trajopt.gaits.shipped import leads_for
from trajopt.gaits.solution import Optimality, Optimum, Solution
from trajopt.gaits.stance import CONTROL_DEGREE, SHORTEST_STEP, gait_problem
from trajopt.gaits.verify import polished, verify
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.results.extremal import Extremal
from trajopt.ocp.search.optima import Outcome, distinct
from trajopt.ocp.solving.refinement import MAX_ELEMENTS
from trajopt.ocp.solving.solve import solve
from trajopt.ocp.solving.ties import least_first
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.nlp import Transcription
from trajopt.ocp.transcribe.rows import Breach
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory
from trajopt.provenance import provenance

#: A first mesh for gaits that come without one of their own.
ELEMENTS, DEGREE = 16, 7

#: Random starts where no shipped gait is near, and how many of their optima are refined.
DEFAULT_STARTS, REFINED = 24, 3

#: Shipped gaits that are tried, one after the other, until one leads to the wanted speed.
MAX_LEADS = 3

#: Most steps in a stride: what a mesh has room for.
MOST_STEPS = MAX_ELEMENTS // ELEMENTS

#: Steps of continuation in speed (m/s), and by what fraction one may be longer: gaits that are a
#: whole number of steps apart are so only to a solver's tolerance.
SPEED_STEP, STRETCH = 0.025, 1e-6

#: A gait of the same machine whose speed differs by less (m/s) is followed with a smaller barrier.
#: (Not a round number, because differences of speeds are.)
SAME_SPEED = 9e-4


class NoGaitError(ValueError):
    """No gait was found; the message says what binds and what to try."""


def periodic_gait(
    params: WheelParams,
    speed: float = 0.5,
    steps: int = 2,
    regeneration: bool = False,
    *,
    starts: int | None = None,
    seed: int = 0,
    guess: Solution | None = None,
    workers: int = 1,
    progress: bool = False,
) -> Solution:
    """The periodic gait of least cost of transport that could be found, verified.

    Many local optima exist. The search starts from `guess` or the best near gait shipped with the
    package, led to the wanted speed in small steps, and from `starts` random guesses; the best
    of them is solved on a refined mesh and re-simulated.

    Args:
        params: the machine.
        speed: mean speed (m/s), > 0 and at most `fastest_walk(params)`, imposed exactly.
        steps: touchdowns per stride, from 1 to `MOST_STEPS`.
        regeneration: whether the battery takes energy back (objective E), or not (E+).
        starts: random starts; by default none where a guess of the same machine exists, else
            `DEFAULT_STARTS`.
        seed: of the random starts.
        guess: a gait of as many steps to start from, instead of the shipped ones.
        workers: processes for the random starts.
        progress: whether to show a progress bar.

    Returns:
        The gait; see its `verification`, which may have failed.

    Raises:
        NoGaitError: none was found at this speed, or the arguments admit none.
        TypeError: an argument is of the wrong kind.
        ValueError: `seed` is negative, or there are no workers.
    """
    speed, steps, starts = _validate(params, speed, steps, starts, guess)
    regeneration, progress = flag("regeneration", regeneration), flag("progress", progress)
    seed, workers = integer("seed", seed, 0), integer("workers", workers, 1)
    leads = [guess] if guess is not None else leads_for(params, speed, steps)[:MAX_LEADS]
    if starts is None:
        known = any(lead.params == params for lead in leads)
        starts = 0 if guess is not None or known else DEFAULT_STARTS
    solved: list[tuple[Extremal, int]] = []
    failures: list[str] = []
    for lead in leads:
        found, obstacle = continued(params, lead, speed, regeneration)
        if found is not None:
            solved.append((found, lead.theta_turns))
            break
        failures.append(obstacle)
    outcomes: list[Outcome] = [_outcome(found, turns) for found, turns in solved]
    if starts > 0:
        family = GaitFamily.of(params, speed, steps, regeneration)
        search = search_gaits(family, starts, seed=seed, workers=workers, progress=progress)
        outcomes += search.outcomes
        best_led = min((found.cost for found, _ in solved), default=math.inf)
        for optimum in search.optima[:REFINED]:
            if optimum.cost < 1.05 * best_led:
                found = _refined(family, optimum.best)
                if found.succeeded:
                    solved.append((found, int(optimum.best.kind)))
        failures += [outcome.failure for outcome in search.failures]
    if not solved:
        raise NoGaitError(_no_gait(params, speed, steps, failures))
    settings = {"speed": speed, "starts": starts, "seed": seed}
    weight = params.weight * steps * params.step_length
    optima = tuple(
        Optimum(o.cost / weight, int(o.best.kind), len(o.found))
        for o in distinct(outcomes, same_gait)
    )
    solutions = []
    for found, turns in least_first(solved, lambda pair: pair[0].cost):
        solution = solution_of(params, found, turns, regeneration, optima, settings)
        if solution.verification.passed:
            return solution
        solutions.append(solution)
    return solutions[0]


def continued(
    params: WheelParams, lead: Solution, speed: float, regeneration: bool
) -> tuple[Extremal | None, str]:
    """`lead` carried over to another speed in small steps; or None, and what is in the way."""

    def problem(at: float) -> Problem:
        turns = lead.theta_turns
        return gait_problem(
            params, speed=at, steps=lead.steps, theta_turns=turns, regeneration=regeneration
        )

    phases, reached, mesh = lead.phases, lead.speed, own_mesh(lead.phases)
    legs = max(1, math.ceil(abs(speed - lead.speed) / SPEED_STEP - STRETCH))
    waypoints = [lead.speed + (speed - lead.speed) * i / legs for i in range(1, legs)]
    if waypoints:
        transcription = Transcription(problem(speed), mesh)
    for waypoint in waypoints:
        result = transcription.solve(phases, problem(waypoint), mu_init=1e-3, max_iter=150)
        if not result.success:
            return None, _obstacle(result.status, result.breaches, reached)
        phases, reached = result.phases, waypoint
    near = lead.params == params and abs(speed - lead.speed) < SAME_SPEED
    found = _solved(problem(speed), phases, mesh, mu_init=1e-5 if near else 1e-3)
    if not found.succeeded:
        return None, _obstacle(found.status, found.breaches, reached)
    return found, ""


def own_mesh(phases: Sequence[PhaseTrajectory]) -> Mesh:
    """The mesh on which `phases` are given."""
    fractions = tuple(tuple(float(s) for s in p.edges / p.duration) for p in phases)
    degrees = tuple((len(p.nodes) - 1,) * (len(p.edges) - 1) for p in phases)
    return Mesh(fractions, degrees, control_degree=CONTROL_DEGREE)


def _refined(family: GaitFamily, outcome: Outcome) -> Extremal:
    problem = gait_problem(
        family.params,
        speed=family.speed,
        steps=family.steps,
        theta_turns=int(outcome.kind),
        regeneration=family.regeneration,
    )
    mesh = Mesh.uniform(problem, ELEMENTS, DEGREE, control_degree=CONTROL_DEGREE)
    return _solved(problem, outcome.phases, mesh, mu_init=1e-4)


def _outcome(found: Extremal, turns: int) -> Outcome:
    """A gait that was led here, as one more start."""
    return Outcome(-1, str(turns), found.cost, found.phases, found.parameters, 0, "")


def _solved(
    problem: Problem, guess: Sequence[PhaseTrajectory], mesh: Mesh, mu_init: float
) -> Extremal:
    """A gait near a guess; the reference simulator verifies it, touchdowns and all."""
    return solve(problem, guess, mesh, verify=False, mu_init=mu_init)


def solution_of(
    params: WheelParams,
    found: Extremal,
    turns: int,
    regeneration: bool,
    optima: tuple[Optimum, ...],
    settings: Mapping[str, object],
) -> Solution:
    """What was found, verified by the reference simulator."""
    phases = polished(params, found.phases, turns)
    return Solution(
        params=params,
        phases=phases,
        theta_turns=turns,
        regeneration=regeneration,
        verification=verify(params, phases, turns),
        optimality=Optimality.of(found),
        optima=optima,
        provenance=provenance(**settings),
    )


def _validate(
    params: Any, speed: Any, steps: Any, starts: Any, guess: Any
) -> tuple[float, int, int | None]:
    """Speed, steps and starts as plain numbers."""
    require_kind("params", params, WheelParams)
    for name, value in (("speed", speed), ("steps", steps), ("starts", starts)):
        if value is None and name == "starts":
            continue
        if isinstance(value, bool) or not isinstance(value, Real):
            raise TypeError(f"{name} = {value!r}: must be a number")
    if not (math.isfinite(speed) and speed > 0):
        raise NoGaitError(f"speed = {speed}: must be finite and greater than 0 m/s")
    fastest = fastest_walk(params)
    if speed > fastest:
        raise NoGaitError(
            f"speed = {speed}: must be at most {fastest:.4g} m/s, at which this machine's legs "
            f"turn at {MAX_RATE:g} rad/s, the fastest that is considered"
        )
    if not (math.isfinite(steps) and steps == int(steps) and steps >= 1):
        raise NoGaitError(f"steps = {steps}: must be a whole number; a stride has at least 1 step")
    if steps > MOST_STEPS:
        raise NoGaitError(
            f"steps = {steps}: must be at most {MOST_STEPS}: a mesh has at most {MAX_ELEMENTS} "
            f"elements, of which each step needs {ELEMENTS}; a shorter stride repeats itself"
        )
    if starts is not None and not (math.isfinite(starts) and starts == int(starts) and starts >= 0):
        raise NoGaitError(f"starts = {starts}: must be a whole number of at least 0")
    if guess is not None and not isinstance(guess, Solution):
        raise TypeError(
            f"guess = {guess!r}: must be a trajopt.Solution; Solution.load reads one from a file"
        )
    if guess is not None and guess.steps != steps:
        raise NoGaitError(
            f"steps = {steps}: the guess has {guess.steps} steps per stride; give one of as many"
        )
    return float(speed), int(steps), None if starts is None else int(starts)


def fastest_walk(params: WheelParams) -> float:
    """The highest mean speed (m/s) of steps that keep to the rates that are considered."""
    c = params.constants
    return params.step_length / max((c.b - c.a) / MAX_RATE, SHORTEST_STEP)


def _obstacle(status: str, breaches: Sequence[Breach], reached: float | None = None) -> str:
    led = f"; {reached:.3f} m/s was reached" if reached is not None else ""
    return f"{status}, {breaches[0] if breaches else 'no constraint violated'}{led}"


def _no_gait(params: WheelParams, speed: float, steps: int, failures: Sequence[str]) -> str:
    tried = "\n  ".join(dict.fromkeys(failures)) or "no start was given"
    return (
        f"no gait of {steps} step(s) per stride was found at {speed} m/s with "
        f"voltage_limit = {params.voltage_limit} V and friction = {params.friction}:\n  {tried}\n"
        "try another speed or number of steps, more starts, or a higher voltage limit or friction"
    )
