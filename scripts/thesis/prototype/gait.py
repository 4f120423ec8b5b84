"""The cheapest gait of one scale, from random starts and from the gaits of other scales."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rimless_gym import hybrid
from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from scripts.thesis.prototype.variant import GEARS, SPEEDS, Variant
from trajopt.gaits.periodic import solution_of
from trajopt.gaits.search import random_guess, same_gait
from trajopt.gaits.solution import Optimum, Solution
from trajopt.gaits.stance import CONTROL_DEGREE, MIN_NORMAL_FORCE
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.results.extremal import Extremal
from trajopt.ocp.search.continuation import continued
from trajopt.ocp.search.curve import Curve, Obstacle
from trajopt.ocp.search.multi_start import multi_start
from trajopt.ocp.search.optima import Outcome, Start
from trajopt.ocp.solving.guesses import Guess
from trajopt.ocp.solving.runs import WARM_BARRIER
from trajopt.ocp.solving.solve import solve
from trajopt.ocp.solving.ties import least_first
from trajopt.ocp.transcribe.mesh import Mesh

#: Random starts per scale, and how many of their optima are refined until one is verified.
STARTS, REFINED = 16, 2

#: Most turns of theta per step, either way: light pendulums whirl.
MOST_TURNS = 8

#: Meshes (elements, degree) of the search and, to begin with, of the refined gait.
SEARCH_MESH, FIRST_MESH = (20, 5), (24, 7)

#: Asked for of the refined mesh: a whirling pendulum makes a step's errors large.
MESH_ERROR, HAMILTONIAN = 1e-9, 1e-1

#: Steps in scale by which a gait is led to another one, and by how much it must be cheaper there
#: than the one it would replace (relative).
LED_STEP, WORTH_IT = 0.1, 1e-3


@dataclasses.dataclass(frozen=True)
class Starts:
    """Starts at one scale: known gaits of others first, then random whirls and swings.

    Attributes:
        variant: supply and gear.
        scale: of the pendulum.
        known: gaits.
    """

    variant: Variant
    scale: float
    known: tuple[Solution, ...] = ()

    def __call__(self, rng: np.random.Generator, index: int) -> Start:
        """Start number `index`."""
        if index < len(self.known):
            gait = self.known[index]
            guess, turns = tuple(gait.phases), gait.theta_turns
            _, gear = self.variant.scale_and_gear(gait)
        else:
            guess, turns = whirling(self.variant.params, rng)
            gear = float(np.exp(rng.uniform(np.log(0.1), 1.0)))
        posed = self.variant.problem(self.scale, turns)
        problems = (regenerating(posed), posed) if index >= len(self.known) else (posed,)
        return Start(guess, np.array([self.scale, np.clip(gear, *GEARS)]), problems, str(turns))


def whirling(params: WheelParams, rng: np.random.Generator) -> tuple[Guess, int]:
    """A random step, and how often its pendulum turns over on top of what it does besides."""
    slow, fast = SPEEDS
    speed = math.exp(rng.uniform(math.log(1.5 * slow), math.log(fast)))
    duration = params.step_length / speed
    (phase,), _ = random_guess(params, 1, duration, rng)
    turns = int(rng.integers(-MOST_TURNS, MOST_TURNS, endpoint=True))
    states = phase.states.copy()
    missing = 2 * math.pi * turns - (states[-1, -1, 1] - states[0, 0, 1])
    share = np.linspace(0.0, 1.0, states[..., 0].size).reshape(states.shape[:2])
    states[..., 1] += missing * share
    states[..., 3] += missing / phase.duration
    return (dataclasses.replace(phase, states=states),), turns


def regenerating(problem: Problem) -> Problem:
    """The problem with E in place of E+: its landscape is smoother."""
    phases = tuple(dataclasses.replace(phase, floor=-math.inf) for phase in problem.phases)
    return dataclasses.replace(problem, phases=phases)


def cheapest(
    variant: Variant, scale: float, known: Sequence[Solution] = (), seed: int = 0
) -> tuple[Solution | None, str]:
    """The cheapest gait that is verified; or None, and why.

    Args:
        variant: supply and gear.
        scale: of the pendulum.
        known: gaits of other scales to start from as well.
        seed: of the random starts.
    """
    family = Starts(variant, scale, tuple(known))
    base = variant.problem(scale, 0)
    mesh = Mesh.uniform(base, *SEARCH_MESH, control_degree=CONTROL_DEGREE)
    search = multi_start(*(base, family, STARTS + len(known)), seed=seed, mesh=mesh, same=same_gait)
    reasons = [outcome.failure for outcome in search.failures]
    optima = tuple(Optimum(o.cost, int(o.best.kind), len(o.found)) for o in search.optima)
    for optimum in search.optima[:REFINED]:
        best = optimum.best
        found = refined(variant, scale, best, int(best.kind), optima)
        if found.verification.passed:
            return found, ""
        reasons.insert(0, "; ".join(found.verification.failures))
    return None, reasons[0] if reasons else "no start was given"


def cheaper(
    variant: Variant, scale: float, best: float, known: Sequence[Solution]
) -> Solution | None:
    """A verified gait that costs less than `best`, by leading others to this scale; or None."""
    reached = []
    for gait in known:
        extremal = led(variant, gait, scale)
        if extremal is not None and extremal.transcribed_cost < (1 - WORTH_IT) * best:
            reached.append((extremal, gait))
    for extremal, gait in least_first(reached, lambda pair: pair[0].transcribed_cost):
        found = refined(variant, scale, extremal, gait.theta_turns, gait.optima)
        if found.verification.passed and found.cot < (1 - WORTH_IT) * best:
            return found
    return None


def led(variant: Variant, gait: Solution, scale: float) -> Extremal | None:
    """A gait of another scale or supply, led to this one; None if it ends before."""
    curve = followed(variant, gait, scale)
    return curve.solutions[-1] if curve.reached else None


def followed(variant: Variant, gait: Solution, scale: float) -> Curve:
    """A gait of another scale or supply, followed towards this one on a coarse mesh."""
    begin, gear = variant.scale_and_gear(gait)
    problem = variant.problem(begin, gait.theta_turns)
    mesh = Mesh.uniform(problem, *SEARCH_MESH, control_degree=CONTROL_DEGREE)
    settings: dict[str, Any] = {"passes": 0, "verify": False}
    parameters = np.array([begin, gear])
    start = solve(
        *(problem, gait.phases, mesh), parameters=parameters, mu_init=WARM_BARRIER, **settings
    )
    if not start.succeeded:
        return Curve(scale, obstacle=Obstacle(begin, "; ".join(start.failures), start))
    if math.isclose(begin, scale, rel_tol=1e-9):  # the gait's own scale, read off its machine
        return Curve(scale, (scale,), (start,))
    return continued(
        lambda s: variant.problem(s, gait.theta_turns),
        start,
        [begin, scale],
        step=LED_STEP,
        **settings,
    )


def refined(
    variant: Variant,
    scale: float,
    near: Outcome | Extremal,
    turns: int,
    optima: tuple[Optimum, ...],
) -> Solution:
    """A gait near one of the search's, on a finer mesh, verified."""
    problem = variant.problem(scale, turns)
    found = solve(
        problem,
        near.phases,
        Mesh.uniform(problem, *FIRST_MESH, control_degree=CONTROL_DEGREE),
        parameters=near.parameters,
        tolerance=MESH_ERROR,
        hamiltonian_tolerance=HAMILTONIAN,
        verify=False,
        mu_init=WARM_BARRIER,
    )
    machine = variant.machine(scale, float(found.parameters[1]))
    settings = {"scale": scale, "variant": variant.name, "starts": STARTS}
    return solution_of(machine, found, turns, False, optima, settings)


def binding(gait: Solution) -> dict[str, float]:
    """What share of a stride's time each limit is reached, by name."""
    t = np.linspace(0.0, gait.duration, 4001)[:-1]
    x, volts = gait.state(t), gait.control(t)
    reaction = HybridModel(gait.params).functions["ground_reaction"].map(len(t))
    fx, fy = np.array(reaction(x.T, volts))
    mu, weight, limit = gait.params.friction, gait.params.weight, gait.params.voltage_limit
    reached = {
        "voltage": np.abs(volts) > 0.999 * limit,
        "friction (forward)": fx > 0.999 * mu * fy,
        "friction (backward)": -fx > 0.999 * mu * fy,
        "normal force": fy < 1.01 * MIN_NORMAL_FORCE * weight,
        "rate": np.abs(x[:, 3]) > 0.999 * hybrid.MAX_RATE,
    }
    return {name: float(np.mean(where)) for name, where in reached.items()}
