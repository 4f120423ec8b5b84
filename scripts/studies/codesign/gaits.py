"""A build's gait of least cost of transport, with its bob, arm and speed; how the gait starts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from agents.evaluate import Protocol, evaluate
from agents.rollout import controller_policy
from rimless_gym.hybrid import CONTROL_PERIOD, motor_torque, relative_rate
from rimless_gym.params import WheelParams
from scripts.studies.codesign.machine import GPX_22_UP, Build, chosen
from trajopt.feedback import laws
from trajopt.gaits.finish import finished
from trajopt.gaits.periodic import NoGaitError, periodic_gait
from trajopt.gaits.problem import CONTROL_DEGREE, WheelPhases
from trajopt.gaits.search import random_motion
from trajopt.gaits.solution import Solution
from trajopt.ocp.constraints import Constraint
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.guesses import Guess
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.ranking import least_first
from trajopt.ocp.solve import solve

#: Bounds on speed (m/s), bob (kg) and arm (m).
SPEEDS, LIGHTEST_BOB, SHORTEST_ARM = (0.3, 1.2), 0.3, 0.08

#: Whole turns of theta in a step, of the family of least cost.
TURNS = -1

#: What the study requires of a gait beyond the preset's limits: least normal force (weights),
#: and the largest friction demand.
NORMAL_FORCE, FRICTION_DEMAND = 0.15, 0.75

#: Largest torque that holds the pendulum level, as a share of what the motor can give: a machine
#: that cannot lift its pendulum has to pump it up, and often fails to.
LIFTED_SHARE = 0.8


def bounds(build: Build) -> dict[str, tuple[float, float]]:
    """On the design variables: bob (kg) and arm (m)."""
    return {"bob": (LIGHTEST_BOB, build.heaviest_bob), "arm": (SHORTEST_ARM, build.longest_arm)}


@lru_cache(maxsize=4)
def step_problem(build: Build) -> Problem:
    """The problem of one periodic step of least E+ per weight and distance, at any speed.

    Its static parameters are the build's bob and arm.
    """
    machine = build.machine(1.0, SHORTEST_ARM).replace(friction=FRICTION_DEMAND)
    wheel, distance = WheelPhases(machine, build.design), machine.step_length
    power, weight = wheel.function("electrical_power"), wheel.function("weight")

    def per_weight_and_distance(x: Any, u: Any, p: Any) -> Any:
        return power(x, u, p) / (weight(x, p) * distance)

    def idle(x: Any, u: Any, p: Any) -> Any:
        return machine.idle_power / (weight(x, p) * distance)

    stance = dataclasses.replace(
        wheel.single_stance(), powers=per_weight_and_distance, floor=0.0, cost=idle
    )
    slow, fast = SPEEDS
    return Problem(
        (_with_margins(stance, build),),
        (wheel.touchdown(0, 0, TURNS),),
        parameters=bounds(build),
        duration=(distance / fast, distance / slow),
    )


def _with_margins(stance: Phase, build: Build) -> Phase:
    path, at_end = stance.path, stance.at_end
    assert path is not None
    assert at_end is not None
    least = np.array([NORMAL_FORCE, *path.lower[1:]])
    stance = dataclasses.replace(stance, path=dataclasses.replace(path, lower=least))
    strength = build.lifting_torque()

    def lifted(x: Any, p: Any) -> Any:
        torque = build.holding_torque(ca.vertsplit(p))
        return ca.vertcat(at_end.function(x, p), torque / strength)

    constraint = Constraint(
        lifted,
        np.append(at_end.lower, 0.0),
        np.append(at_end.upper, LIFTED_SHARE),
        (*at_end.names, "torque that lifts the pendulum"),
    )
    return dataclasses.replace(stance, at_end=constraint)


def neighbours(build: Build, builds: Sequence[Build]) -> list[Build]:
    """The builds that differ from one by one leg, then by the next gearhead; larger ones first."""

    def far(each: Build) -> int:
        gears = GPX_22_UP.index(each.gearhead) - GPX_22_UP.index(build.gearhead)
        return abs(each.n_legs - build.n_legs) + abs(gears)

    near = [each for each in reversed(builds) if far(each) == 1]
    return sorted(near, key=lambda each: each.n_legs == build.n_legs)


# -- gaits ----------------------------------------------------------------------------------------

#: Random starts of a build.
STARTS = 3

#: IPOPT's first barrier where a gait is refined.
WARM_BARRIER = 1e-5

#: Settings of a search's solves: one attempt each, on the search's mesh.
_QUICK: dict[str, Any] = {"passes": 0, "verify": False, "option_sets": ({},), "max_iter": 200}

#: Meshes (elements, degree): of the search, and the first one of the refined gait.
SEARCH_MESH, FIRST_MESH = (20, 5), (24, 7)

#: Refinements of a gait's mesh at most, and its tolerances. A whirling pendulum makes the errors of
#: a step large.
PASSES, MESH_ERROR, HAMILTONIAN = 5, 1e-9, 1e-1

#: Optima that are refined until one is verified, and by how much (relative) a gait must cost less
#: than the one that it replaces.
REFINED, WORTH_IT = 2, 1e-3

#: How many of the known gaits, those of the nearest speeds, are continued to a speed.
CONTINUED = 3


def best_gait(build: Build, known: Sequence[Solution] = (), starts: int = STARTS) -> Solution | str:
    """The verified gait of least cost from others' gaits and random starts, or why none is."""
    problem = step_problem(build)
    mesh = Mesh.uniform(problem, *SEARCH_MESH, control_degree=CONTROL_DEGREE)
    # E in place of E+ makes the landscape smoother
    smooth_stance = dataclasses.replace(problem.phases[0], floor=-math.inf)
    regenerating = dataclasses.replace(problem, phases=(smooth_stance,))
    low, high = np.array(list(bounds(build).values())).T
    extremals = []
    for gait in known:
        bob_and_arm = np.clip(np.array(chosen(gait.params)), low, high)
        extremals.append(
            solve(problem, gait.phases, mesh, parameters=bob_and_arm, mu_init=1e-3, **_QUICK)
        )
    rng = np.random.default_rng(0)
    for _ in range(starts):
        step, middle = random_step(build, rng), (low + high) / 2
        smooth = solve(regenerating, step, mesh, parameters=middle, **_QUICK)
        if smooth.succeeded:
            extremals.append(
                solve(problem, smooth.phases, mesh, parameters=smooth.parameters, **_QUICK)
            )
    good = [each for each in extremals if each.succeeded and not each.violations]
    reason = "no start became a gait"
    for each in least_first(good, lambda extremal: extremal.transcribed_cost)[:REFINED]:
        gait = refined(build, each)
        if gait.verification.passed:
            return gait
        reason = "; ".join(gait.verification.failures)
    return reason


def better_gait(build: Build, best: Solution | str, known: Sequence[Solution]) -> Solution | str:
    """The gait continued from others if it costs less than `best`, else `best`."""
    other = best_gait(build, known, starts=0)
    if isinstance(other, str):
        return best
    better = isinstance(best, str) or other.cot < (1 - WORTH_IT) * best.cot
    return other if better else best


def refined(build: Build, near: Extremal) -> Solution:
    """A gait near an optimum of the search, on a finer mesh, verified."""
    problem = step_problem(build)
    extremal = solve(
        problem,
        near.phases,
        Mesh.uniform(problem, *FIRST_MESH, control_degree=CONTROL_DEGREE),
        parameters=near.parameters,
        passes=PASSES,
        mu_init=WARM_BARRIER,
        tolerance=MESH_ERROR,
        hamiltonian_tolerance=HAMILTONIAN,
        verify=False,
    )
    bob, arm = (float(value) for value in extremal.parameters)
    return finished(build.machine(bob, arm), extremal, TURNS, False, {"study": "codesign"})


def random_step(build: Build, rng: np.random.Generator) -> Guess:
    """A random step with `TURNS` of theta."""
    params = build.machine(1.0, 0.1)
    slow, fast = SPEEDS
    speed = math.exp(rng.uniform(math.log(1.3 * slow), math.log(fast / 1.2)))
    return random_motion(params, 1, params.step_length / speed, TURNS, rng)


def gait_at(params: WheelParams, speed: float, known: Sequence[Solution]) -> Solution | str:
    """A machine's best gait at a speed (m/s) that continues from a known one, or why none does."""
    gaits, reason = [], "no gait is known"
    for near in sorted(known, key=lambda each: abs(each.speed - speed))[:CONTINUED]:
        try:
            gait = periodic_gait(params, speed, near.steps, guess=near)
        except NoGaitError as error:
            reason = str(error)
            continue
        if gait.verification.passed:
            gaits.append(gait)
        else:
            reason = "; ".join(gait.verification.failures)
    return least_first(gaits, lambda each: each.cot)[0] if gaits else reason


def held_gait(gait: Solution) -> Solution | str:
    """The gait that the environment allows, its voltage held, near one that is not; or why none."""
    try:
        return periodic_gait(gait.params, gait.speed, gait.steps, hold=CONTROL_PERIOD, guess=gait)
    except NoGaitError as error:
        return str(error)


# -- start-up -------------------------------------------------------------------------------------

#: Seconds until a start must be in the gait, and over which its speed is then measured.
JOINED, MEASURED = 10.0, 4.0

#: Deviation of that speed from the gait's (relative) up to which a start is in the gait.
SAME_SPEED = 0.05


def start_up(gait: Solution, starts: int) -> dict[str, Any]:
    """How the law for a gait starts, and figures of the gait, as plain JSON values."""
    policy = controller_policy(gait.params, laws.design("lqr", gait))
    protocol = Protocol(
        starts=starts, duration=JOINED + MEASURED, window=MEASURED, alive=MEASURED / 2
    )
    walk = evaluate(policy, gait.params, protocol)
    near = np.abs(walk.speeds / gait.speed - 1) < SAME_SPEED
    return figures(gait) | {"starts": starts, "joined": float(np.mean(walk.walking & near))}


def start_up_and_walk(gait: Solution) -> dict[str, Any]:
    """`start_up` from all starts of the protocol, and how they walk at the protocol's end."""
    walk = evaluate(controller_policy(gait.params, laws.design("lqr", gait)), gait.params)
    return start_up(gait, walk.protocol.starts) | {
        "walking": walk.walking_share,
        "cot_of_walks": walk.cot if walk.walking.any() else None,
    }


def figures(gait: Solution) -> dict[str, Any]:
    """Figures of a gait and its machine as plain JSON values."""
    v, (bob, arm) = gait.verification, chosen(gait.params)
    t = np.linspace(0.0, gait.duration, 400, endpoint=False)
    x, p = gait.state(t), gait.params
    rate = relative_rate(x[:, 2], x[:, 3], p.constants)
    torque = motor_torque(rate, gait.control(t), p.constants)
    return {
        "legs": p.n_legs,
        "ratio": p.gear_ratio,
        "bob": bob,
        "arm": arm,
        "cot": gait.cot,
        "speed": gait.speed,
        "multiplier": float(abs(gait.floquet[0])),
        "friction_demand": max(v.max_friction_demand, v.max_impulse_friction_demand),
        "normal_force": v.min_normal_force_over_weight,
        "peak_torque": float(np.abs(torque).max()),
        "motor_speed": float(np.abs(rate).max() * p.gear_ratio),
    }
