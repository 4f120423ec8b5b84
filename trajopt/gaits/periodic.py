"""Periodic gaits of least cost of transport: the search, from warm starts and random ones."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rimless_gym.checks import flag, integer, positive
from rimless_gym.hybrid import MAX_RATE
from rimless_gym.params import WheelParams
from rimless_gym.presets import Machine, as_params
from trajopt.gaits.bounds import motor_deficit
from trajopt.gaits.finish import finished
from trajopt.gaits.held_gait import held_gait
from trajopt.gaits.held_stride import held_speed, ticks_of_stride
from trajopt.gaits.library import gaits_around, warm_starts
from trajopt.gaits.problem import (
    CONTROL_DEGREE,
    SHORTEST_STEP,
    fastest_pressed,
    fastest_walk,
    gait_problem,
)
from trajopt.gaits.search import possible_turns, search_gaits
from trajopt.gaits.solution import Solution
from trajopt.gaits.verify import verify
from trajopt.ocp.continuation import Curve, continued
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.guesses import line
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.multi_start import Search
from trajopt.ocp.problem import Problem
from trajopt.ocp.ranking import least_first
from trajopt.ocp.refinement import MAX_ELEMENTS
from trajopt.ocp.solve import WARM_BARRIER, solve
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.pool import progress_bar

#: First mesh of a gait that comes from a random start.
ELEMENTS, DEGREE = 16, 7

#: Random starts where no gait of the machine is known, and how many of a search's optima are
#: refined.
DEFAULT_STARTS, REFINED = 60, 3

#: Optima of a search are refined if they cost less than this times the gait continued from a known
#: one: the search's mesh is coarse.
WORTH_REFINING = 1.05

#: Most shipped gaits that are tried as warm starts, one after the other, until one succeeds; and
#: how far the second one may be in speed (m/s).
MOST_WARM_STARTS, SECOND_WARM_START = 3, 0.06

#: Most steps in a stride: those for which a mesh has room.
MOST_STEPS = MAX_ELEMENTS // ELEMENTS

#: The speed (m/s) where none is asked for.
USUAL_SPEED = 0.62

#: Speeds (m/s) that differ by less are the same.
SAME = 1e-9

#: With what a search that found no gait is made again, at other limits and speeds.
SHORT_SEARCH: dict[str, Any] = {"starts": 8, "shipped": 1}


class Solved(NamedTuple):
    """A gait of a problem on a fine mesh."""

    extremal: Extremal  # the optimum
    turns: int  # whole turns of theta per stride
    search: dict[str, float]  # of a gait that a search found: how many of how many starts met it


class NoGaitError(ValueError):
    """No gait was found; the message has what binds and what to try."""


def periodic_gait(
    params: Machine,
    speed: float | None = None,
    steps: int = 1,
    regeneration: bool = False,
    *,
    step_time: float | None = None,
    double_stance: bool = False,
    hold: float | None = None,
    starts: int | None = None,
    seed: int = 0,
    guess: Solution | None = None,
    workers: int = 1,
    progress: bool = True,
) -> Solution:
    """The periodic gait of least cost of transport that the search finds, verified.

    Many local optima exist. The gaits of a machine that is shipped, or a `guess`, are continued to
    the wanted speed in small steps. For any other machine the search starts from shipped gaits of
    every winding number, and from `starts` random motions of every winding number that the motor
    allows. The best results are solved on a refined mesh and re-simulated.

    With a `hold`, the voltage is constant between the ticks of a clock, as it is in the
    environment with ``hold=0.01``. The touchdowns fall anywhere between two ticks; where, the
    optimisation chooses. A stride must last a whole number of periods to repeat itself. So the
    speed is not the one asked for, but the nearest of those that are possible
    (`trajopt.gaits.held_stride.held_speed`): see the result's `speed`. The search starts from the
    gait with a continuous voltage at that speed.

    Args:
        params: the machine, a preset's name, or a dictionary of fields that differ from the
            default's.
        speed: mean speed (m/s), > 0 and at most `fastest_walk(params)`, imposed exactly unless
            there is a `hold`; by default `USUAL_SPEED`.
        steps: touchdowns per stride, from 1 to `MOST_STEPS`.
        regeneration: whether the battery takes energy back (objective E), or not (E+).
        step_time: mean time of a step (s) instead of a speed: what changed machines have in common
            under a clock.
        double_stance: whether the wheel lands at rest once in a stride, stands on two feet, and
            lifts off again. Such gaits are continued from a guess or from shipped ones; where there
            is neither, from gaits with as many steps, with a short stop.
        hold: period of the clock (s), at least 1 ms and at most half a step, or None.
        starts: number of random starts; by default none if a gait of the same machine is known,
            else `DEFAULT_STARTS`.
        seed: of the random starts.
        guess: a gait of as many steps to start from, instead of the shipped ones; it is verified
            anew. One that has a hold itself, or the very speed, is what the search for a held gait
            starts from.
        workers: processes for the starts.
        progress: whether to show progress on a terminal.

    Returns:
        The gait; see its `verification`, which may have failed.

    Raises:
        NoGaitError: no gait was found, or there can be none with these arguments.
        TypeError: an argument is of the wrong type.
        ValueError: an argument is out of its range.
    """
    params = as_params(params)
    if step_time is not None:
        if speed is not None:
            raise ValueError(f"speed = {speed}, step_time = {step_time}: give one of them")
        speed = params.step_length / positive("step_time", step_time)
    speed = USUAL_SPEED if speed is None else speed
    speed, steps, starts = _arguments(params, speed, steps, starts, guess)
    if guess and guess.hold is None:
        anew = verify(guess.params, guess.phases, guess.theta_turns)
        guess = dataclasses.replace(guess, verification=anew)
    regeneration, progress = flag("regeneration", regeneration), flag("progress", progress)
    seed, workers = integer("seed", seed, 0), integer("workers", workers, 1)
    stops = flag("double_stance", double_stance)
    if stops and (hold is not None or starts):
        raise ValueError(
            f"double_stance = True with hold = {hold}, starts = {starts}: no held gait and no "
            "random start stops; leave both out"
        )
    search: dict[str, Any] = {"steps": steps, "regeneration": regeneration}
    search |= {"starts": starts, "seed": seed, "workers": workers, "progress": progress}
    title = f"gait at {speed:g} m/s"
    with progress_bar(title, progress, bar_format="{desc} ...", leave=False):
        if stops:
            return _stopping(params, speed, steps, regeneration, guess)
        if hold is not None:
            hold = positive("hold", hold)
            free = _free_gait(params, (speed, hold), guess, **search)
            return _held(free, speed, hold, regeneration)
        return _found(params, speed, guess, **search)


def _found(
    params: WheelParams,
    speed: float,
    guess: Solution | None,
    *,
    steps: int,
    regeneration: bool,
    starts: int | None,
    **search: Any,
) -> Solution:
    """The gait of `periodic_gait` whose voltage is free."""
    known = [guess] if guess else warm_starts(params, speed, steps, MOST_WARM_STARTS)
    if starts is None:
        starts = 0 if known else DEFAULT_STARTS
    solved, failures = _continued_from(known, params, speed, regeneration)
    if starts > 0 or not known:
        random = search_gaits(params, speed, steps, regeneration, starts=starts, **search)
        least = min((each.extremal.cost for each in solved), default=math.inf)
        solved += _best_refined(random, WORTH_REFINING * least)
    if not solved:
        short = search | SHORT_SEARCH
        why = _binding(failures) if known else _remedies(params, speed, steps, short)
        raise NoGaitError(_no_gait(params, speed, steps, why))
    settings = {"speed": speed, "starts": starts, "seed": search["seed"]}
    already = [gait for gait in known if _answers(gait, params, speed, regeneration)]
    solutions = []
    for extremal, turns, met in least_first(solved, lambda each: each.extremal.cost):
        solution = finished(params, extremal, turns, regeneration, settings | met)
        if solution.verification.passed:
            return least_first([solution, *already], lambda gait: gait.cot)[0]
        solutions.append(solution)
    # A slow gait magnifies deviations: solved again it may fail where it passed once.
    return least_first(already or solutions, lambda gait: gait.cot)[0]


def _stopping(
    params: WheelParams, speed: float, steps: int, regeneration: bool, guess: Solution | None
) -> Solution:
    """The gait of `periodic_gait` that stops in every stride."""
    known = [guess] if guess else warm_starts(params, speed, steps, double_stance=True)
    known = known or warm_starts(params, speed, steps, MOST_WARM_STARTS)
    known = known or gaits_around(speed, steps, 1)[:MOST_WARM_STARTS]
    known = [gait if gait.double_stance else with_stop(gait) for gait in known]
    solved, failures = _continued_from(known, params, speed, regeneration)
    if not solved:
        raise NoGaitError(_no_gait(params, speed, steps, _binding(failures)))
    extremal, turns, _ = least_first(solved, lambda each: each.extremal.cost)[0]
    return finished(params, extremal, turns, regeneration, {"speed": speed})


def with_stop(gait: Solution) -> Solution:
    """A gait with a short stop at the end of its stride: a guess of one that stops, no gait."""
    _, theta, _, rate = gait.phases[-1].end
    a, short = gait.params.constants.a, 1.5 * SHORTEST_STEP
    ends = np.array([a, theta, 0.0, rate]), np.array([a, theta + rate * short, 0.0, rate])
    standing = line(*ends, np.zeros(1), short)
    return dataclasses.replace(gait, phases=(*gait.phases, standing))


def _answers(gait: Solution, params: WheelParams, speed: float, regeneration: bool) -> bool:
    """Whether a known gait is itself a verified one of this machine, speed and objective."""
    same = gait.params == params and gait.regeneration == regeneration and gait.hold is None
    return same and abs(gait.speed - speed) < SAME and gait.verification.passed


def _free_gait(
    params: WheelParams, wanted: tuple[float, float], guess: Solution | None, **search: Any
) -> Solution:
    """The gait from which the search for a held one starts.

    Args:
        params: the machine.
        wanted: the commanded speed (m/s), and the hold (s).
        guess: the caller's guess. It will do if it has a hold too, or the very speed.
        search: further arguments of `periodic_gait`.
    """
    (speed, hold), steps = wanted, search["steps"]
    possible = held_speed(params, speed, steps, hold)
    if guess is not None:
        near = guess.hold is not None or abs(guess.speed - possible) < SAME
        if near and guess.params == params:
            return guess
    try:
        return periodic_gait(params, possible, guess=guess, **search)
    except NoGaitError as error:
        raise NoGaitError(
            f"{error}\n({possible:.6g} m/s is the speed nearest to {speed:g} m/s at which a stride "
            f"lasts a whole number of intervals of hold = {hold:g} s)"
        ) from None


def _held(free: Solution, speed: float, hold: float, regeneration: bool) -> Solution:
    """The held gait near a known gait."""
    ticks = ticks_of_stride(free.params, speed, free.steps, hold)
    settings = {"speed": speed, "hold": hold, "free_cot": free.cot}
    gait, failures = held_gait(free, hold, ticks, regeneration, settings)
    if gait is None:
        raise NoGaitError(_no_gait(free.params, speed, free.steps, _binding(failures)))
    return gait


def _continued_from(
    known: Sequence[Solution], params: WheelParams, speed: float, regeneration: bool
) -> tuple[list[Solved], list[str]]:
    """The gaits continued from the first suitable known ones; and why earlier ones did not succeed.

    The first gait will do if the known one has the very speed, or is of another machine. Between
    two known gaits the nearer one need not lead to the gait of less cost, so one more is tried.
    """
    solved: list[Solved] = []
    failures: list[str] = []
    for gait in known:
        gap = abs(gait.speed - speed)
        if solved and gap > SECOND_WARM_START:
            break
        extremal, obstacle = warm_started(params, gait, speed, regeneration)
        if extremal is None:
            failures.append(obstacle)
            continue
        solved.append(Solved(extremal, gait.theta_turns, {}))
        if len(solved) == 2 or gap < SAME or gait.params != params:
            break
    return solved, failures


def _best_refined(search: Search, most: float) -> list[Solved]:
    """The best optima of a search that cost less than `most`, solved on a finer mesh."""
    solved = []
    for optimum in search.optima[:REFINED]:
        if optimum.cost < most:
            problem = search.start(optimum.best.index).problems[-1]
            mesh = Mesh.uniform(problem, ELEMENTS, DEGREE, control_degree=CONTROL_DEGREE)
            extremal = solve(problem, optimum.phases, mesh, verify=False, mu_init=WARM_BARRIER)
            met: dict[str, float] = {"met": len(optimum.starts), "tried": len(search.outcomes)}
            solved.append(Solved(extremal, int(optimum.best.kind), met))
    return [each for each in solved if each.extremal.succeeded]


def _arguments(
    params: WheelParams, speed: Any, steps: Any, starts: Any, guess: Any
) -> tuple[float, int, int | None]:
    """Speed, steps and starts as plain numbers; refuses those with which there is no gait."""
    speed, steps = positive("speed", speed), integer("steps", steps, 1)
    starts = None if starts is None else integer("starts", starts, 0)
    if steps > MOST_STEPS:
        raise NoGaitError(
            f"steps = {steps}: must be at most {MOST_STEPS}, because a mesh has at most "
            f"{MAX_ELEMENTS} elements and each step needs {ELEMENTS}; solve for a shorter stride, "
            "which repeats itself"
        )
    if guess is not None and not isinstance(guess, Solution):
        raise TypeError(
            f"guess = {guess!r}: must be a trajopt.Solution; Solution.load reads one from a file"
        )
    if guess is not None and guess.steps != steps:
        raise NoGaitError(
            f"steps = {steps}: the guess has {guess.steps} steps per stride; give a guess with "
            f"{steps}"
        )
    _require_possible(params, speed, steps)
    return speed, steps, starts


def _require_possible(params: WheelParams, speed: float, steps: int) -> None:
    """Refuse a speed at which physics allows no gait, with the quantity that is short."""
    fastest, pressed = fastest_walk(params), fastest_pressed(params)
    if speed > fastest:
        raise NoGaitError(
            f"speed = {speed}: must be at most {fastest:.4g} m/s, at which this machine's legs "
            f"turn at {MAX_RATE:g} rad/s, the fastest that is considered"
        )
    if speed > pressed:
        raise NoGaitError(
            f"speed = {speed}: must be at most {pressed:.4g} m/s, above which this machine's feet "
            "lift off: the hub falls too far in a step for its pendulum to make up; a heavier or "
            "longer pendulum, or more legs, allow a higher speed"
        )
    if params.friction < (steepness := abs(math.tan(params.slope))):
        raise NoGaitError(
            f"friction = {params.friction:g}: must be at least {steepness:.3g}, the tangent of the "
            "slope along which the feet bear the weight; lower the slope or raise the friction"
        )
    if not possible_turns(params, speed, steps):
        short = min(motor_deficit(params, speed, k / steps) for k in range(-steps, 1))
        raise NoGaitError(
            f"voltage_limit = {params.voltage_limit:g}: the motor is {short:.3g} W short of what "
            f"friction, damping, drag and slope take at least at {speed:g} m/s; raise the voltage "
            "limit, or lower the losses, the slope or the speed"
        )


def _no_gait(params: WheelParams, speed: float, steps: int, why: str) -> str:
    """What was not found; what binds, and what to try."""
    return (
        f"no gait of {steps} step(s) per stride was found at {speed:g} m/s with "
        f"voltage_limit = {params.voltage_limit:g} V and friction = {params.friction:g}\n{why}"
    )


def _binding(failures: Sequence[str]) -> str:
    """What binds and what to try, where known gaits were continued."""
    return (
        f"what binds: {'; '.join(dict.fromkeys(failures))}\n"
        "what to try: another speed or number of steps, random starts, or a higher voltage limit "
        "or friction"
    )


def _remedies(params: WheelParams, speed: float, steps: int, short: dict[str, Any]) -> str:
    """The same after a search: with which other limits and speeds a short one finds gaits."""
    volts, friction = 2 * params.voltage_limit, 2 * params.friction
    others = {
        f"voltage_limit = {volts:g}": (params.replace(voltage_limit=volts), speed),
        f"friction = {friction:g}": (params.replace(friction=friction), speed),
        f"speed = {speed / 2:g}": (params, speed / 2),
    }
    remedies, useless = [], []
    for name, (machine, other) in others.items():
        search = search_gaits(machine, other, steps, **short)
        if search.optima:
            remedies.append(f"{name} (CoT {search.optima[0].cost / search.unit[1]:.2g})")
        else:
            useless.append(name)
    binds = [text.split(" = ")[0] for text in remedies] or ["more than one limit"]
    rest = f"; no gait was found with {' or '.join(useless)}" if useless else ""
    return (
        f"what binds: {', '.join(binds)}{rest}\n"
        f"what to try: {' or '.join(remedies) or 'several of these together'}; more starts"
    )


# -- warm starts ----------------------------------------------------------------------------------

#: Longest step of continuation in speed (m/s), and by what fraction a single one may be longer:
#: the speeds of gaits a whole number of steps apart are exact only to a solver's tolerance.
SPEED_STEP, STRETCH = 0.025, 1e-6

#: Shortest step (m/s). Shorter ones come a little nearer to where a family of gaits ends, and take
#: several times as long to find out that it does.
LEAST_SPEED_STEP = SPEED_STEP / 2

#: A gait of the same machine whose speed differs by less (m/s) is solved with a smaller barrier.
#: (Not a round number, because differences of speeds are.)
SAME_SPEED = 9e-4

#: IPOPT's first barrier on the way and for the same gait again, and its iterations on the way.
BARRIER, SAME_BARRIER, ITERATIONS = 1e-3, 1e-5, 150


def warm_started(
    params: WheelParams, gait: Solution, speed: float, regeneration: bool
) -> tuple[Extremal | None, str]:
    """A gait continued to a machine, speed and objective; or None, and what is in the way."""

    def problem(speed: float) -> Problem:
        return gait_problem(
            params,
            speed=speed,
            steps=gait.steps,
            theta_turns=gait.theta_turns,
            regeneration=regeneration,
            double_stance=gait.double_stance,
        )

    mesh = _mesh(gait, problem(gait.speed))
    phases: Sequence[PhaseTrajectory] = gait.phases
    reached = gait.speed
    if abs(speed - gait.speed) > (1 + STRETCH) * SPEED_STEP:
        curve = continued(
            problem,
            gait.phases,
            [gait.speed, speed],
            mesh=mesh,
            step=SPEED_STEP,
            shortest=LEAST_SPEED_STEP,
            passes=0,
            verify=False,
            option_sets=({},),
            mu_init=BARRIER,
            max_iter=ITERATIONS,
        )
        if not curve.reached:
            return None, _stopped(curve, gait.speed)
        phases, reached = curve.solutions[-1].phases, speed
    same = gait.params == params and abs(speed - gait.speed) < SAME_SPEED
    extremal = solve(
        problem(speed), phases, mesh, verify=False, mu_init=SAME_BARRIER if same else BARRIER
    )
    return (extremal, "") if extremal.succeeded else (None, _obstacle(extremal, reached))


def _mesh(gait: Solution, problem: Problem) -> Mesh:
    """The gait's mesh; a uniform one if its voltage is held, with an element per interval.

    So is that of a gait `with_stop`.
    """
    if gait.hold is not None or len(gait.phases[-1].edges) == 2:
        return Mesh.uniform(problem, ELEMENTS, DEGREE, control_degree=CONTROL_DEGREE)
    fractions = tuple(tuple(float(s) for s in p.edges / p.duration) for p in gait.phases)
    degrees = tuple((len(p.nodes) - 1,) * (len(p.edges) - 1) for p in gait.phases)
    return Mesh(fractions, degrees, control_degree=CONTROL_DEGREE)


def _stopped(curve: Curve, begin: float) -> str:
    """Why a curve did not reach its goal."""
    reached = curve.values[-1] if curve.values else begin
    assert curve.obstacle is not None  # Ctrl-C raises
    attempt = curve.obstacle.attempt
    if attempt is None or attempt.succeeded:
        return f"{curve.obstacle.reason}; {reached:.3f} m/s was reached"
    return _obstacle(attempt, reached)


def _obstacle(extremal: Extremal, reached: float) -> str:
    worst = extremal.violations[0] if extremal.violations else "no constraint violated"
    return f"{worst}; {reached:.3f} m/s was reached"
