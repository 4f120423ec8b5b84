"""Periodic gaits of least cost of transport."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

from rimless_gym.checks import flag, integer, positive
from rimless_gym.hybrid import MAX_RATE
from rimless_gym.params import WheelParams
from rimless_gym.presets import Machine, as_params
from trajopt.gaits.finishing import finished
from trajopt.gaits.gait_problem import gait_problem
from trajopt.gaits.held.clock import held_speed, ticks_of_stride
from trajopt.gaits.held.gait import held_gait
from trajopt.gaits.leading import led
from trajopt.gaits.optimality import LocalOptimum
from trajopt.gaits.power import lacks_power
from trajopt.gaits.search import GaitFamily, same_gait, search_gaits
from trajopt.gaits.shipped import leads_for
from trajopt.gaits.solution import Solution
from trajopt.gaits.stance import CONTROL_DEGREE, SHORTEST_STEP
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.multi_start import Optimum, Outcome, distinct
from trajopt.ocp.ranking import least_first
from trajopt.ocp.refinement import MAX_ELEMENTS
from trajopt.ocp.solve import WARM_BARRIER, solve

#: First mesh of a gait that comes from a random start.
ELEMENTS, DEGREE = 16, 7

#: Random starts where no gait of the machine is known, and how many of their optima are refined.
DEFAULT_STARTS, REFINED = 24, 3

#: Optima of random starts are refined if they cost less than this times the gait led from a known
#: one: the search's mesh is coarse.
WORTH_REFINING = 1.05

#: Most shipped gaits that are tried, one after the other, until one leads to the wanted speed.
MAX_LEADS = 3

#: Farthest that a second lead may be in speed (m/s).
SECOND_LEAD = 0.06

#: Most steps in a stride: those for which a mesh has room.
MOST_STEPS = MAX_ELEMENTS // ELEMENTS

#: Speeds (m/s) that differ by less are the same.
SAME = 1e-9

#: An optimum and its number of turns of theta per stride.
Turning: TypeAlias = tuple[Extremal, int]


class NoGaitError(ValueError):
    """No gait was found; the message says what binds and what to try."""


def periodic_gait(
    params: Machine,
    speed: float = 0.5,
    steps: int = 1,
    regeneration: bool = False,
    *,
    hold: float | None = None,
    starts: int | None = None,
    seed: int = 0,
    guess: Solution | None = None,
    workers: int = 1,
    progress: bool = False,
) -> Solution:
    """The periodic gait of least cost of transport that the search finds, verified.

    Many local optima exist. The search starts from `guess`, or else from the best gait nearby that
    is shipped with the package, led to the wanted speed in small steps; and from `starts` random
    motions. The best result is solved on a refined mesh and re-simulated.

    With a `hold`, the voltage is constant between the ticks of a clock, as it is in the
    environment with ``hold=0.01``. The touchdowns fall anywhere between two ticks; where, the
    optimisation chooses. A stride must last a whole number of periods to repeat itself. So the
    speed is not the one asked for, but the nearest of those that are possible
    (`trajopt.gaits.held.clock.held_speed`): see the result's `speed`. The search starts from the
    gait with a continuous voltage at that speed.

    Args:
        params: the machine, a preset's name, or a dictionary of fields that differ from the
            default's.
        speed: mean speed (m/s), > 0 and at most `fastest_walk(params)`, imposed exactly unless
            there is a `hold`.
        steps: touchdowns per stride, from 1 to `MOST_STEPS`.
        regeneration: whether the battery takes energy back (objective E), or not (E+).
        hold: period of the clock (s), at least 1 ms and at most half a step, or None.
        starts: number of random starts; by default none if a gait of the same machine is known,
            else `DEFAULT_STARTS`.
        seed: of the random starts.
        guess: a gait of as many steps to start from, instead of the shipped ones. One that has a
            hold itself, or the very speed, is what the search for a held gait starts from.
        workers: processes for the random starts.
        progress: whether to show a progress bar.

    Returns:
        The gait; see its `verification`, which may have failed.

    Raises:
        NoGaitError: no gait was found, or there can be none with these arguments.
        TypeError: an argument is of the wrong type.
        ValueError: an argument is out of its range.
    """
    params = as_params(params)
    speed, steps, starts = _arguments(params, speed, steps, starts, guess)
    regeneration, progress = flag("regeneration", regeneration), flag("progress", progress)
    seed, workers = integer("seed", seed, 0), integer("workers", workers, 1)
    if hold is not None:
        hold = positive("hold", hold)
        search_for: dict[str, Any] = {"steps": steps, "regeneration": regeneration}
        search_for |= {"starts": starts, "seed": seed, "workers": workers, "progress": progress}
        lead = _unheld(params, (speed, hold), guess, **search_for)
        return _held(lead, speed, hold, regeneration)
    leads = [guess] if guess is not None else leads_for(params, speed, steps)[:MAX_LEADS]
    if starts is None:
        known = any(lead.params == params for lead in leads)
        starts = 0 if guess is not None or known else DEFAULT_STARTS
    solved, failures = _from_leads(params, leads, speed, regeneration)
    outcomes = [_outcome(found, turns) for found, turns in solved]
    if starts > 0:
        family = GaitFamily.of(params, speed, steps, regeneration)
        search = search_gaits(family, starts, seed=seed, workers=workers, progress=progress)
        outcomes += search.outcomes
        failures += [outcome.failure for outcome in search.failures]
        best_led = min((found.cost for found, _ in solved), default=math.inf)
        solved += _best_refined(family, search.optima[:REFINED], WORTH_REFINING * best_led)
    if not solved:
        raise NoGaitError(_no_gait(params, speed, steps, failures))
    settings = {"speed": speed, "starts": starts, "seed": seed}
    weight = params.weight * steps * params.step_length
    optima = tuple(
        LocalOptimum(o.cost / weight, int(o.best.kind), len(o.starts))
        for o in distinct(outcomes, same_gait)
    )
    known_here = [lead for lead in leads if _is_of(lead, params, speed, regeneration)]
    solutions = []
    for found, turns in least_first(solved, lambda pair: pair[0].cost):
        solution = finished(params, found, turns, regeneration, optima, settings)
        if solution.verification.passed:
            return least_first([solution, *known_here], lambda gait: gait.cot)[0]
        solutions.append(solution)
    # A slow gait magnifies deviations so much that solved again it may fail where it passed once.
    return least_first(known_here or solutions, lambda gait: gait.cot)[0]


def _is_of(lead: Solution, params: WheelParams, speed: float, regeneration: bool) -> bool:
    """Whether a verified gait is itself one of this machine, speed and objective."""
    same = lead.params == params and lead.regeneration == regeneration and lead.hold is None
    return same and abs(lead.speed - speed) < SAME and lead.verification.passed


def _unheld(
    params: WheelParams, wanted: tuple[float, float], guess: Solution | None, **search: Any
) -> Solution:
    """The gait from which the search for a held one starts.

    Args:
        params: the machine.
        wanted: the speed asked for (m/s), and the hold (s).
        guess: the caller's guess. It will do if it has a hold too, or the very speed.
        search: further arguments of `periodic_gait`.
    """
    (speed, hold), steps = wanted, search["steps"]
    at = held_speed(params, speed, steps, hold)
    if guess is not None:
        near = guess.hold is not None or abs(guess.speed - at) < SAME
        if near and guess.params == params:
            return guess
    try:
        return periodic_gait(params, at, guess=guess, **search)
    except NoGaitError as error:
        raise NoGaitError(
            f"{error}\n({at:.6g} m/s is the speed nearest to {speed:g} m/s at which a stride lasts "
            f"a whole number of intervals of hold = {hold:g} s)"
        ) from None


def _held(lead: Solution, speed: float, hold: float, regeneration: bool) -> Solution:
    """The held gait that a known gait leads to."""
    ticks = ticks_of_stride(lead.params, speed, lead.steps, hold)
    settings = {"speed": speed, "hold": hold, "lead_cot": lead.cot}
    gait, failures = held_gait(lead, hold, ticks, regeneration, settings)
    if gait is None:
        raise NoGaitError(_no_gait(lead.params, speed, lead.steps, failures))
    return gait


def _from_leads(
    params: WheelParams, leads: Sequence[Solution], speed: float, regeneration: bool
) -> tuple[list[Turning], list[str]]:
    """The gaits to which the first suitable leads lead, if any; and why those before did not.

    The first gait will do if its lead has the very speed, or is of another machine. Between two
    known gaits the nearer one need not lead to the cheaper gait, so that one more is tried.
    """
    solved: list[Turning] = []
    failures: list[str] = []
    for lead in leads:
        gap = abs(lead.speed - speed)
        if solved and gap > SECOND_LEAD:
            break
        found, obstacle = led(params, lead, speed, regeneration)
        if found is None:
            failures.append(obstacle)
            continue
        solved.append((found, lead.theta_turns))
        if len(solved) == 2 or gap < SAME or lead.params != params:
            break
    return solved, failures


def _best_refined(family: GaitFamily, optima: Sequence[Optimum], most: float) -> list[Turning]:
    """The optima that cost less than `most`, solved on a finer mesh."""
    cheap = [optimum.best for optimum in optima if optimum.cost < most]
    refined = [(_refined(family, outcome), int(outcome.kind)) for outcome in cheap]
    return [(found, turns) for found, turns in refined if found.succeeded]


def _refined(family: GaitFamily, outcome: Outcome) -> Extremal:
    problem = gait_problem(
        family.params,
        speed=family.speed,
        steps=family.steps,
        theta_turns=int(outcome.kind),
        regeneration=family.regeneration,
    )
    mesh = Mesh.uniform(problem, ELEMENTS, DEGREE, control_degree=CONTROL_DEGREE)
    return solve(problem, outcome.phases, mesh, verify=False, mu_init=WARM_BARRIER)


def _outcome(found: Extremal, turns: int) -> Outcome:
    """A gait that was led here, counted as one more start."""
    return Outcome(-1, str(turns), found.cost, found.phases, found.parameters, 0, "")


def _arguments(
    params: WheelParams, speed: Any, steps: Any, starts: Any, guess: Any
) -> tuple[float, int, int | None]:
    """Speed, steps and starts as plain numbers; refuses those with which there is no gait."""
    speed, steps = positive("speed", speed), integer("steps", steps, 1)
    starts = None if starts is None else integer("starts", starts, 0)
    fastest = fastest_walk(params)
    if speed > fastest:
        raise NoGaitError(
            f"speed = {speed}: must be at most {fastest:.4g} m/s, at which this machine's legs "
            f"turn at {MAX_RATE:g} rad/s, the fastest that is considered"
        )
    if steps > MOST_STEPS:
        raise NoGaitError(
            f"steps = {steps}: must be at most {MOST_STEPS}, because a mesh has at most "
            f"{MAX_ELEMENTS} elements and each step needs {ELEMENTS}; solve for a shorter stride, "
            "which repeats itself"
        )
    if lacking := lacks_power(params, speed, steps):
        raise NoGaitError(lacking)
    if guess is not None and not isinstance(guess, Solution):
        raise TypeError(
            f"guess = {guess!r}: must be a trajopt.Solution; Solution.load reads one from a file"
        )
    if guess is not None and guess.steps != steps:
        raise NoGaitError(
            f"steps = {steps}: the guess has {guess.steps} steps per stride; give a guess with "
            f"{steps}"
        )
    return speed, steps, starts


def fastest_walk(params: WheelParams) -> float:
    """The highest mean speed (m/s) of steps within the rates that are considered."""
    c = params.constants
    return params.step_length / max((c.b - c.a) / MAX_RATE, SHORTEST_STEP)


def _no_gait(params: WheelParams, speed: float, steps: int, failures: Sequence[str]) -> str:
    tried = "\n  ".join(dict.fromkeys(failures)) or "no start was given"
    return (
        f"no gait of {steps} step(s) per stride was found at {speed} m/s with "
        f"voltage_limit = {params.voltage_limit} V and friction = {params.friction}:\n  {tried};\n"
        "try another speed or number of steps, more starts, or a higher voltage limit or friction"
    )
