"""Machines between the one that was simulated and the one that was built, and their supplies."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.presets import PROTOTYPE
from rimless_gym.symbolic import Design
from trajopt.gaits.periodic import finished
from trajopt.gaits.problem import CONTROL_DEGREE, designed_gait
from trajopt.gaits.search import random_guess, same_gait
from trajopt.gaits.solution import Solution
from trajopt.ocp.constraints import pair
from trajopt.ocp.continuation import Curve, Obstacle, continued
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.guesses import Guess
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.multi_start import Outcome, Start, multi_start
from trajopt.ocp.problem import Problem
from trajopt.ocp.ranking import least_first
from trajopt.ocp.solve import WARM_BARRIER, solve

#: Mass and length of the pendulum in units of those as built; 4 is the machine of Table 4.6.
SCALES = (4.0, 3.5, 3.0, 2.5, 2.0, 1.75, 1.6, 1.5, 1.4, 1.3, 1.2, 1.15, 1.1, 1.0)

#: Bounds on the mean speed (m/s); a slower wheel would balance for seconds in every step.
SPEEDS = (0.1, 0.7)

#: Bounds on a gear ratio that is to be chosen, in units of the ratio as built.
GEARS = (0.02, 20.0)


def scaled(p: Any) -> Mapping[str, Any]:
    """Fields of a machine whose pendulum, a rod, is scaled by p[0], and its gear ratio by p[1]."""
    mass, length = p[0] * PROTOTYPE.pendulum_mass, p[0] * PROTOTYPE.pendulum_length
    return {
        "pendulum_mass": mass,
        "pendulum_length": length,
        "pendulum_inertia": mass * length**2 / 3,
        "gear_ratio": p[1] * PROTOTYPE.gear_ratio,
    }


DESIGN = Design(("scale", "gear"), scaled)


@dataclasses.dataclass(frozen=True)
class Variant:
    """A motor supply and gear.

    Attributes:
        name: as in tables.
        voltage: largest (V).
        gear: ratio in units of the one as built, or bounds on it.
    """

    name: str
    voltage: float
    gear: float | tuple[float, float] = 1.0

    @property
    def params(self) -> WheelParams:
        """The machine as built, with this supply."""
        return PROTOTYPE.replace(voltage_limit=self.voltage)

    @property
    def file_name(self) -> str:
        """The name as files and folders have it."""
        return self.name.replace(" ", "_").replace(",", "")

    def machine(self, scale: float, gear: float) -> WheelParams:
        """The machine of a scale and gear ratio."""
        return DESIGN.machine(self.params, (scale, gear))

    def scale_and_gear(self, gait: Solution) -> tuple[float, float]:
        """Scale and gear ratio of a gait's machine."""
        built = self.params
        scale = gait.params.pendulum_length / built.pendulum_length
        return scale, gait.params.gear_ratio / built.gear_ratio

    def admits(self, other: Variant) -> bool:
        """Whether every gait of another supply and gear is possible with this one too."""
        (low, high), (least, most) = pair(self.gear), pair(other.gear)
        return self.voltage >= other.voltage and low <= least and most <= high

    def problem(self, scale: float | tuple[float, float], turns: int) -> Problem:
        """The problem of a periodic step of least cost of transport at any speed.

        Args:
            scale: of the pendulum.
            turns: of theta per step.
        """
        ring = _ring(self.voltage)
        link = dataclasses.replace(ring.linkages[0], offset=_offset(turns))
        bounds = {"scale": scale, "gear": self.gear}
        return dataclasses.replace(ring, linkages=(link,), parameters=bounds)


VARIANTS = (
    Variant("20 V", 20.0),
    Variant("65 V", 65.0),
    Variant("20 V, gear ratio free", 20.0, GEARS),
)


@lru_cache(maxsize=4)
def _ring(voltage: float) -> Problem:
    params = PROTOTYPE.replace(voltage_limit=voltage)
    slow, fast = SPEEDS
    return designed_gait(
        *(params, DESIGN, {"scale": (0.1, 10.0), "gear": GEARS}),
        steps=1,
        duration=(params.step_length / fast, params.step_length / slow),
    )


def _offset(turns: int) -> dict[str, float]:
    return {"theta": -2 * math.pi * turns}


#: Random starts per scale, and how many of their optima are refined until one is verified.
STARTS, REFINED = 16, 2

#: Meshes (elements, degree): of the search, and the first one of the refined gait.
SEARCH_MESH, FIRST_MESH = (20, 5), (24, 7)

#: Tolerances of the refined mesh. A whirling pendulum makes the errors of a step large.
MESH_ERROR, HAMILTONIAN = 1e-9, 1e-1

#: Longest step in scale by which a gait is led to another one.
LED_STEP = 0.1

#: By how much (relative) a gait must be cheaper than the one that it replaces.
WORTH_IT = 1e-3


def cheapest(
    variant: Variant, scale: float, known: Sequence[Solution] = (), seed: int = 0
) -> tuple[Solution | None, str]:
    """The cheapest gait that passes verification and "", or None and the reason.

    Args:
        variant: supply and gear.
        scale: of the pendulum.
        known: gaits of other scales, from which some starts begin.
        seed: of the random starts.
    """
    family = StartsAtScale(variant, scale, tuple(known))
    base = variant.problem(scale, 0)
    mesh = Mesh.uniform(base, *SEARCH_MESH, control_degree=CONTROL_DEGREE)
    search = multi_start(*(base, family, STARTS + len(known)), seed=seed, mesh=mesh, same=same_gait)
    reasons = [outcome.failure for outcome in search.failures]
    for optimum in search.optima[:REFINED]:
        best = optimum.best
        found = refined(variant, scale, best, int(best.kind))
        if found.verification.passed:
            return found, ""
        reasons.insert(0, "; ".join(found.verification.failures))
    return None, reasons[0] if reasons else "no start was given"


def cheaper(
    variant: Variant, scale: float, best: float, known: Sequence[Solution]
) -> Solution | None:
    """A verified gait that costs less than `best`, led here from other gaits; or None."""
    reached = []
    for gait in known:
        curve = followed(variant, gait, scale)
        if curve.reached and curve.solutions[-1].transcribed_cost < (1 - WORTH_IT) * best:
            reached.append((curve.solutions[-1], gait))
    for extremal, gait in least_first(reached, lambda pair: pair[0].transcribed_cost):
        found = refined(variant, scale, extremal, gait.theta_turns)
        if found.verification.passed and found.cot < (1 - WORTH_IT) * best:
            return found
    return None


def followed(variant: Variant, gait: Solution, scale: float) -> Curve:
    """A gait of another scale or supply, followed towards this one on a coarse mesh.

    Args:
        variant: supply and gear.
        gait: where to begin.
        scale: goal.
    """
    begin, gear = variant.scale_and_gear(gait)
    problem = variant.problem(begin, gait.theta_turns)
    mesh = Mesh.uniform(problem, *SEARCH_MESH, control_degree=CONTROL_DEGREE)
    settings: dict[str, Any] = {"passes": 0, "verify": False}
    parameters = np.array([begin, gear])
    start = solve(
        *(problem, gait.phases, mesh), parameters=parameters, mu_init=WARM_BARRIER, **settings
    )
    if not start.succeeded:
        return Curve(obstacle=Obstacle(begin, "; ".join(start.failures), start))
    if math.isclose(begin, scale, rel_tol=1e-9):  # the gait's own scale, read off its machine
        return Curve((scale,), (start,))
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
) -> Solution:
    """A gait near an optimum of the search, on a finer mesh, verified."""
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
    return finished(machine, found, turns, False, settings)


#: Most turns of theta per step, either way: light pendulums whirl.
MOST_TURNS = 8


@dataclasses.dataclass(frozen=True)
class StartsAtScale:
    """A family of starts; the known gaits come first, then random motions.

    Attributes:
        variant: supply and gear.
        scale: of the pendulum.
        known: gaits of other scales.
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
    """A random step, and its number of turns of theta."""
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
    """The problem with E in place of E+, whose landscape is smoother."""
    phases = tuple(dataclasses.replace(phase, floor=-math.inf) for phase in problem.phases)
    return dataclasses.replace(problem, phases=phases)
