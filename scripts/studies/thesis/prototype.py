"""Whether the machine as built can walk: its gaits, followed from larger pendulums down.

A point is the cheapest gait of a supply and a scale of the pendulum. The scales of a supply are
searched one after the other, from large to small; then gaits of neighbours are led to each point,
and replace its own if they cost less. Every point is stored as soon as it is found.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.presets import PROTOTYPE, THESIS_PHYSICAL
from rimless_gym.symbolic import Design
from scripts.studies import designed_gaits
from scripts.studies.designed_gaits import (
    REFINED,
    WORTH_IT,
    gaits_of,
    regenerating,
    search_mesh,
    stage,
    with_turns,
)
from scripts.studies.documents import markdown
from trajopt.gaits.library import shipped
from trajopt.gaits.periodic import finished
from trajopt.gaits.problem import designed_gait
from trajopt.gaits.search import random_guess, same_gait
from trajopt.gaits.solution import Solution
from trajopt.ocp.constraints import pair
from trajopt.ocp.continuation import Curve, Obstacle, continued
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.guesses import Guess
from trajopt.ocp.multi_start import Outcome, Start, multi_start
from trajopt.ocp.problem import Problem
from trajopt.ocp.ranking import least_first
from trajopt.ocp.solve import WARM_BARRIER, solve
from trajopt.store import Store, provenance, write_text

#: Most rounds of improvement.
ROUNDS = 2

#: The scales of the page's table; results.json has all.
SHOWN = (4.0, 3.0, 2.0, 1.6, 1.3, 1.15, 1.0)

#: Columns of the table: heading and format.
COLUMNS = {
    "supply": "{variant}",
    "scale": "{scale:g}",
    "CoT": "{cot:.4f}",
    "speed (m/s)": "{speed:.3f}",
    "turns": "{theta_turns}",
    "gear": "{gear:.3f}",
    "least Fy / weight": "{min_normal_force_over_weight:.2f}",
    "friction demand": "{max_friction_demand:.2f}",
    "peak V": "{peak_voltage:.1f}",
    "clearance (m)": "{clearance:.2f}",
    "state error": "{state_error:.0e}",
}

MARKS = markdown.marks("thesis", ("prototype",))


@dataclasses.dataclass(frozen=True)
class Point:
    """The cheapest gait of a supply and scale."""

    variant: Variant
    scale: float  # of the pendulum
    gait: Solution | None  # verified
    reason: str = ""  # why none was found

    @property
    def key(self) -> str:
        """Its name in the store."""
        return f"{self.variant.file_name}_{self.scale:.3f}"

    def row(self) -> dict[str, Any]:
        """Its figures as plain JSON values."""
        row: dict[str, Any] = {"variant": self.variant.name, "scale": self.scale}
        if self.gait is None:
            return row | {"cot": None, "reason": self.reason}
        v, gear = self.gait.verification, self.variant.params.gear_ratio
        return row | {
            "cot": self.gait.cot,
            "reason": "",
            "speed": self.gait.speed,
            "theta_turns": self.gait.theta_turns,
            "gear": self.gait.params.gear_ratio / gear,
            "min_normal_force_over_weight": v.min_normal_force_over_weight,
            "max_friction_demand": max(v.max_friction_demand, v.max_impulse_friction_demand),
            "peak_voltage": v.peak_voltage,
            "clearance": v.clearance,
            "state_error": v.state_error,
            "energy_audit": v.energy_audit,
        }


def study(folder: Path, workers: int | None = None, docs: Path | None = None) -> None:
    """Find the gaits of every supply and scale, and print their table, or put it into `docs`."""
    with Store(folder, provenance()) as store:
        run = partial(stage, store, workers=workers)
        points = searched(run)
        for number in range(1, ROUNDS + 1):
            tasks = {
                p.key: (p.variant, p.scale, p.gait and p.gait.cot, neighbours(p, points))
                for p in points
            }
            better = gaits_of(run(f"round {number} of {ROUNDS}", tasks, cheaper))
            points = [
                dataclasses.replace(point, gait=better.get(point.key, point.gait))
                for point in points
            ]
            if not better:
                break
    points = shared(points)
    results = {"gaits": [point.row() for point in points], "provenance": provenance()}
    write(results, folder)
    if docs:
        write(results, docs.parent / "figures" / "prototype")
        for point in points:
            if point.gait is not None and point.scale == SCALES[-1]:
                name = f"as_built_{point.variant.file_name}.npz"
                point.gait.save(docs.parent / "figures" / "prototype" / name)
        markdown.refresh(docs, MARKS, {"prototype": table(results)})
    print(table(results))


def searched(stage: Callable[..., dict[str, Any]]) -> list[Point]:
    """Every point, from the largest pendulum down, also from gaits of the two scales before."""
    points: dict[tuple[Variant, float], Point] = {}
    known = {variant: first_gaits() for variant in VARIANTS}
    for scale in SCALES:
        tasks = {each.file_name: (each, scale, known[each]) for each in VARIANTS}
        results = stage(f"scale {scale:.3f}", tasks, cheapest).values()
        for variant, found in zip(VARIANTS, results, strict=True):
            if isinstance(found, Solution):
                points[variant, scale] = Point(variant, scale, found)
                known[variant] = (found, *known[variant])[:2]
            else:
                points[variant, scale] = Point(variant, scale, None, found)
    return [points[variant, scale] for variant in VARIANTS for scale in SCALES]


def first_gaits() -> tuple[Solution, ...]:
    """The cheapest shipped gaits of one step: their machine is that of the largest scale."""
    known = [gait for gait in shipped() if gait.steps == 1 and gait.params == THESIS_PHYSICAL]
    return tuple(least_first(known, lambda gait: gait.cot)[:2])


def neighbours(point: Point, points: Sequence[Point]) -> list[Solution]:
    """Gaits of the next scales of a supply, or of the same scale of lesser supplies."""
    scales = sorted({p.scale for p in points if p.variant == point.variant and p.gait})
    below = [scale for scale in scales if scale < point.scale][-1:]
    above = [scale for scale in scales if scale > point.scale][:1]
    beginning = [] if above else list(first_gaits())
    return beginning + [
        p.gait
        for p in points
        if p.gait is not None and point.variant.admits(p.variant)
        if p.scale in (below + above if p.variant == point.variant else [point.scale])
    ]


def shared(points: Sequence[Point]) -> list[Point]:
    """The points, each with the cheapest gait of its own supply and those whose gaits it admits."""
    best = []
    for point in points:
        lesser = [
            p.gait
            for p in points
            if p.gait is not None and p.scale == point.scale and point.variant.admits(p.variant)
        ]
        if lesser:
            gait = least_first(lesser, lambda gait: gait.cot)[0]
            params = gait.params.replace(voltage_limit=point.variant.voltage)
            point = Point(point.variant, point.scale, dataclasses.replace(gait, params=params))
        best.append(point)
    return best


def write(results: dict[str, Any], folder: Path) -> None:
    """Write results.json into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "results.json", json.dumps(results, indent=1, allow_nan=False) + "\n")


def table(results: dict[str, Any]) -> str:
    """A row per gait."""
    walking = [row for row in results["gaits"] if row["cot"] and row["scale"] in SHOWN]
    return markdown.formatted(COLUMNS, walking) + "\n"


# -- the machines ----------------------------------------------------------------------------------

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
    """A motor supply and gear."""

    name: str  # as in tables
    voltage: float  # largest (V)
    gear: float | tuple[float, float] = 1.0  # ratio in units of the one as built, or bounds on it

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
        """The problem of a periodic step of least cost of transport at any speed."""
        bounds = {"scale": scale, "gear": self.gear}
        return turning(dataclasses.replace(_ring(self.voltage), parameters=bounds), turns)


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


def turning(problem: Problem, turns: int) -> Problem:
    """The problem with so many turns of theta per step; shares its functions."""
    link = dataclasses.replace(problem.linkages[0], offset={"theta": -2 * math.pi * turns})
    return dataclasses.replace(problem, linkages=(link,))


# -- the search ------------------------------------------------------------------------------------

#: Random starts per scale.
STARTS = 16

#: Longest step in scale by which a gait is led to another one.
LED_STEP = 0.1


def cheapest(
    variant: Variant, scale: float, known: Sequence[Solution] = (), seed: int = 0
) -> Solution | str:
    """The verified gait of least cost, some starts from known ones, or the reason why none is."""
    base = variant.problem(scale, 0)
    family = StartsAtScale(variant, scale, base, tuple(known))
    search = multi_start(
        *(base, family, STARTS + len(known)), seed=seed, mesh=search_mesh(base), same=same_gait
    )
    reasons = [outcome.failure for outcome in search.failures]
    for optimum in search.optima[:REFINED]:
        best = optimum.best
        found = refined(variant, scale, best, int(best.kind))
        if found.verification.passed:
            return found
        reasons.insert(0, "; ".join(found.verification.failures))
    return reasons[0] if reasons else "no start was given"


def cheaper(
    variant: Variant, scale: float, best: float | None, known: Sequence[Solution]
) -> Solution | None:
    """A verified gait that costs less than `best`, if any, led here from other gaits; or None."""
    reached, most = [], (1 - WORTH_IT) * (math.inf if best is None else best)
    for gait in known:
        curve = followed(variant, gait, scale)
        if curve.reached and curve.solutions[-1].transcribed_cost < most:
            reached.append((curve.solutions[-1], gait))
    for extremal, gait in least_first(reached, lambda pair: pair[0].transcribed_cost):
        found = refined(variant, scale, extremal, gait.theta_turns)
        if found.verification.passed and found.cot < most:
            return found
    return None


def followed(variant: Variant, gait: Solution, scale: float) -> Curve:
    """A gait of another scale or supply, followed to this scale and supply on a coarse mesh."""
    begin, gear = variant.scale_and_gear(gait)
    problem = variant.problem(begin, gait.theta_turns)
    mesh = search_mesh(problem)
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


def refined(variant: Variant, scale: float, near: Outcome | Extremal, turns: int) -> Solution:
    """A gait near an optimum of the search, on a finer mesh, verified."""
    problem = variant.problem(scale, turns)
    found = designed_gaits.refined(problem, near, mu_init=WARM_BARRIER)
    machine = variant.machine(scale, float(found.parameters[1]))
    settings = {"scale": scale, "variant": variant.name, "starts": STARTS}
    return finished(machine, found, turns, False, settings)


#: Most turns of theta per step, either way: light pendulums whirl.
MOST_TURNS = 8


@dataclasses.dataclass(frozen=True)
class StartsAtScale:
    """A family of starts; the known gaits come first, then random motions."""

    variant: Variant  # supply and gear
    scale: float  # of the pendulum
    problem: Problem  # without turns; those of all starts share its functions
    known: tuple[Solution, ...] = ()  # gaits of other scales

    def __call__(self, rng: np.random.Generator, index: int) -> Start:
        """Start number `index`."""
        if index < len(self.known):
            gait = self.known[index]
            guess, turns = tuple(gait.phases), gait.theta_turns
            _, gear = self.variant.scale_and_gear(gait)
        else:
            guess, turns = whirling(self.variant.params, rng)
            gear = float(np.exp(rng.uniform(np.log(0.1), 1.0)))
        posed = turning(self.problem, turns)
        problems = (regenerating(posed), posed) if index >= len(self.known) else (posed,)
        return Start(guess, np.array([self.scale, np.clip(gear, *GEARS)]), problems, str(turns))


def whirling(params: WheelParams, rng: np.random.Generator) -> tuple[Guess, int]:
    """A random step, and its number of turns of theta."""
    slow, fast = SPEEDS
    speed = math.exp(rng.uniform(math.log(1.5 * slow), math.log(fast)))
    duration = params.step_length / speed
    guess, _ = random_guess(params, 1, duration, rng)
    turns = int(rng.integers(-MOST_TURNS, MOST_TURNS, endpoint=True))
    return with_turns(guess, turns), turns
