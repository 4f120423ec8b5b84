"""The results of a search, held in its store, and what they leave to be tried."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise, product
from typing import Any

from rimless_gym.params import WheelParams
from scripts.studies.fronts.solving import (
    Continuation,
    Joint,
    Place,
    RandomStarts,
    SearchGait,
    SolveAttempt,
    Task,
)
from trajopt.ocp.trajectory import phases_from_arrays, phases_to_arrays
from trajopt.store import Store

#: Numbers of steps per stride that are searched.
STEPS = (1, 2, 3)

#: Gaits of every family (number of turns) that are listed, the best ones.
BEST = 2

#: Two seeds agree at a speed where their costs of transport differ by no more (relative).
AGREEMENT = 0.005

#: Between neighbouring speeds whose costs differ by more than this factor, one more is put.
STEEP = 1.25

#: Most turns of the pendulum per step, either way, of the families that are screened.
MOST_TURNS = 8

#: Random starts of a family in one round of screening: without turns and with some, of one step;
#: the same of more steps. A family with turns is given up if its first start becomes no gait.
SWINGS, WHIRLS, LONG_SWINGS, LONG_WHIRLS = 4, 2, 2, 1

#: By how much the pendulum's mean rate may exceed the highest that one-step gaits have shown.
RATE_MARGIN = 1.05

#: One-step gaits of a speed around whose turns per step the families of more steps are screened.
GUIDES = 2

#: Strides that are joined of one-step gaits at a speed: those of least estimated cost, if it is
#: less than this times the least known. Their steps' time may be wrong by this share.
JOINED, PROMISING, WRONG_TIME = 3, 1.05, 0.1

#: A gait is continued if it costs less than this times the highest cost of its seed's envelope
#: within `AROUND` (m/s): the front has narrow valleys, and continuation crosses them.
NEAR, AROUND = 1.3, 0.1

#: Most gaits of a place that are continued; the best one without turns is continued as well.
MOST_CONTINUED = 4


@dataclasses.dataclass(frozen=True)
class PlaceResults:
    """What one seed tried and found at one speed and number of steps."""

    place: Place
    gaits: tuple[SearchGait, ...] = ()  # different ones, best first
    # random starts by turns: how many were tried, and how many became gaits
    starts: Mapping[int, tuple[int, int]] = dataclasses.field(default_factory=dict)
    # keys of the gaits that were continued to here or joined, with success or not
    known: frozenset[str] = frozenset()

    def tried(self, turns: int) -> int:
        """Random starts that were tried with so many turns."""
        return self.starts.get(turns, (0, 0))[0]

    def given_up(self, turns: int) -> bool:
        """Whether a family with turns was given up at its first random start."""
        return turns != 0 and self.starts.get(turns) == (1, 0)

    def has(self, gait: SearchGait) -> bool:
        """Whether the gait is among those found."""
        return any(gait.same_as(other) for other in self.gaits)

    def after(self, attempt: SolveAttempt) -> PlaceResults:
        """The results with one more attempt."""
        starts, known = dict(self.starts), self.known
        if attempt.known is not None:
            known |= {attempt.known}
        else:
            tried, good = starts.get(attempt.turns, (0, 0))
            starts[attempt.turns] = (tried + 1, good + (attempt.gait is not None))
        after = dataclasses.replace(self, starts=starts, known=known)
        return after if attempt.gait is None else after.with_gait(attempt.gait)

    def with_gait(self, gait: SearchGait) -> PlaceResults:
        """The results with one more gait, unless it is among them already."""
        if self.has(gait):
            return self
        gaits: list[SearchGait] = []
        for each in sorted([*self.gaits, gait], key=lambda g: g.cot):
            if sum(each.turns == other.turns for other in gaits) < BEST:
                gaits.append(each)
        return dataclasses.replace(self, gaits=tuple(gaits))

    def to_value(self) -> dict[str, Any]:
        """For the store; `from_value` is the inverse."""
        return {
            "place": self.place,
            "gaits": [vars(g) | {"phases": phases_to_arrays(g.phases)} for g in self.gaits],
            "starts": [[turns, *count] for turns, count in sorted(self.starts.items())],
            "known": sorted(self.known),
        }

    @classmethod
    def from_value(cls, value: Mapping[str, Any]) -> PlaceResults:
        """From what `to_value` returned."""
        gaits = [
            SearchGait(**each | {"phases": phases_from_arrays(each["phases"])})
            for each in value["gaits"]
        ]
        starts = {turns: (tried, good) for turns, tried, good in value["starts"]}
        return cls(Place(*value["place"]), tuple(gaits), starts, frozenset(value["known"]))


class SearchResults:
    """The results of all seeds at a machine, by place; every change is written to the store."""

    def __init__(self, params: WheelParams, store: Store) -> None:
        self.params, self.store = params, store
        self.places: dict[Place, PlaceResults] = {}
        for path in sorted(store.folder.glob("search/*.json")):
            if f"search/{path.stem}" in store:  # damaged ones are searched again
                results = PlaceResults.from_value(store.load(f"search/{path.stem}"))
                self.places[results.place] = results
        # speeds (m/s), ascending, rounded to 1e-4 m/s
        self.grid = sorted({place.speed for place in self.places})

    def at(self, place: Place) -> PlaceResults:
        """The results at a place; empty ones where nothing was tried."""
        return self.places.get(place, PlaceResults(place))

    def save(self, results: PlaceResults) -> None:
        """Replace the results at their place."""
        place = results.place
        self.places[place] = results
        key = f"search/seed{place.seed}_{place.steps}_steps_{place.speed:.4f}"
        self.store.save(key, results.to_value())

    def add(self, place: Place, made: Iterable[SolveAttempt], source: float | None = None) -> None:
        """Add attempts; `source` is the speed from which a gait was continued, if it was."""
        before = after = self.at(place)
        for attempt in made:
            after = after.after(attempt)
            if source is None or attempt.gait is None or before.has(attempt.gait):
                continue
            # The way back ends where it came from.
            back = SolveAttempt(attempt.turns, attempt.gait.key, None)
            self.save(self.at(place._replace(speed=source)).after(back))
        self.save(after)

    def widen(self, speeds: Iterable[float]) -> int:
        """Add speeds to the grid; how many were new."""
        before = len(self.grid)
        self.grid = sorted({*self.grid, *(round(speed, 4) for speed in speeds)})
        return len(self.grid) - before

    def of_seed(self, seed: int) -> Iterator[PlaceResults]:
        """The results of a seed, by speed, then steps."""
        ours = sorted((p.speed, p.steps) for p in self.places if p.seed == seed)
        yield from (self.places[Place(seed, speed, steps)] for speed, steps in ours)

    def envelope(self, *seeds: int) -> dict[float, SearchGait]:
        """The gait of least cost that any of these seeds found, by speed, ascending."""
        best: dict[float, SearchGait] = {}
        for seed in seeds:
            for results in self.of_seed(seed):
                for gait in results.gaits[:1]:
                    if gait.speed not in best or gait.cot < best[gait.speed].cot:
                        best[gait.speed] = gait
        return dict(sorted(best.items()))

    def costs(self, *seeds: int) -> dict[float, float]:
        """The costs of transport of `envelope`."""
        return {speed: gait.cot for speed, gait in self.envelope(*seeds).items()}


def disagreements(one: Mapping[float, float], other: Mapping[float, float]) -> dict[float, float]:
    """By speed, by how much the larger cost exceeds the smaller; infinite where one lacks it."""
    gaps = {}
    for speed in sorted({*one, *other}):
        less, more = sorted(costs.get(speed, math.inf) for costs in (one, other))
        gaps[speed] = more / less - 1
    return gaps


def midpoints(grid: Sequence[float], costs: Mapping[float, float], finest: float) -> list[float]:
    """Speeds midway between neighbours where the front is steep or ends, `finest` apart or more."""
    middle = []
    for low, high in pairwise(grid):
        if high - low < 2 * finest * (1 - 1e-6) or not (low in costs or high in costs):
            continue
        ends = low not in costs or high not in costs
        if ends or not 1 / STEEP < costs[high] / costs[low] < STEEP:
            middle.append((low + high) / 2)
    return middle


# -- what is left to be tried ---------------------------------------------------------------------


def one_step(
    seed: int, results: SearchResults, speeds: Iterable[float], rounds: int = 1
) -> list[Task]:
    """Random starts of one-step gaits: no turns, and outwards to `MOST_TURNS` either way.

    A side is given up at the first number of turns whose first start becomes no gait.
    """
    tasks: list[Task] = []
    for speed in speeds:
        here = results.at(Place(seed, speed, 1))
        tasks += _lacking(here, [0], SWINGS * rounds)
        for sign in (-1, 1):
            side = [sign * k for k in range(1, MOST_TURNS + 1)]
            end = next((i for i, k in enumerate(side) if here.given_up(k)), len(side))
            tasks += _lacking(here, side[:end], WHIRLS * rounds, outwards=True)
    return tasks


def more_steps(
    seed: int, results: SearchResults, speeds: Iterable[float], rounds: int = 1
) -> list[Task]:
    """Random starts of gaits of more than one step, in the families of `families`."""
    tasks: list[Task] = []
    for speed in speeds:
        for steps in STEPS[1:]:
            here = results.at(Place(seed, speed, steps))
            swinging, *whirling = families(results, here.place)
            tasks += _lacking(here, [swinging], LONG_SWINGS * rounds)
            whirling = [turns for turns in whirling if not here.given_up(turns)]
            tasks += _lacking(here, whirling, LONG_WHIRLS * rounds)
    return tasks


def families(results: SearchResults, place: Place) -> list[int]:
    """Turns per stride worth screening with more steps: none, and those near good one-step gaits.

    Near is less than one turn per step from one of the best `GUIDES` one-step families of the
    speed, at a mean rate that one-step gaits of the seed have shown at any speed.
    """
    L, steps = results.params.step_length, place.steps
    ones = [g for here in results.of_seed(place.seed) for g in here.gaits if g.steps == 1]
    rates = [0.0, *(gait.turns * gait.speed / L for gait in ones)]  # turns per second
    slowest, fastest = RATE_MARGIN * min(rates), RATE_MARGIN * max(rates)
    guides = [gait.turns for gait in distinct(results.at(place._replace(steps=1)).gaits)][:GUIDES]
    near = {
        k
        for guide in guides
        for k in range(steps * (guide - 1) + 1, steps * (guide + 1))
        if slowest <= k * place.speed / (steps * L) <= fastest and k != 0
    }
    return [0, *sorted(near, key=lambda k: (abs(k), k))]


def near_envelope(
    seed: int, results: SearchResults, speeds: Iterable[float], steps: Iterable[int], rounds: int
) -> list[Task]:
    """Random starts in the families that are near the seed's envelope, and without turns.

    Of one-step families one turn away from these there are fewer, as they may have been given up.
    """
    tasks: list[Task] = []
    envelope = results.envelope(seed)
    for place in [Place(seed, speed, count) for speed in speeds for count in steps]:
        here, highest = results.at(place), ceiling(envelope, place.speed)
        near = [gait.turns for gait in distinct(here.gaits) if gait.cot <= highest]
        tasks += _lacking(here, [0], LONG_SWINGS * rounds)
        tasks += _lacking(here, [k for k in near if k != 0][:MOST_CONTINUED], WHIRLS * rounds)
        if place.steps == 1:
            beside = {k + i for k in near[:GUIDES] for i in (-1, 1)} - {0, *near}
            tasks += _lacking(here, sorted(beside), rounds)
    return tasks


def joints(seed: int, results: SearchResults) -> list[Task]:
    """Strides of a fast and a slow one-step gait, one of them perhaps twice.

    A stride of uneven steps can cost less than one of even steps: part of the time the wheel walks
    at a speed that suits its pendulum.
    """
    envelope = results.envelope(seed)
    ones = [
        gait
        for here in results.of_seed(seed)
        if here.place.steps == 1
        for gait in worth_continuing(here, ceiling(envelope, here.place.speed))
    ]
    tasks: list[Task] = []
    for steps in STEPS[1:]:
        offers = [
            ((count, fast.turns, slow.turns), (fast,) * count + (slow,) * (steps - count))
            for fast, slow in product(ones, ones)
            for count in range(1, steps)
            if fast.speed > slow.speed
        ]
        for place in [Place(seed, speed, steps) for speed in results.grid]:
            tasks += promising(results, place, offers, JOINED, PROMISING, WRONG_TIME)
    return tasks


def promising(
    results: SearchResults,
    place: Place,
    offers: Iterable[tuple[tuple[int, ...], tuple[SearchGait, ...]]],
    most: int,
    margin: float,
    wrong_time: float,
) -> list[Task]:
    """The joints of least estimated cost, if it is less than `margin` times the least known.

    Of the parts offered with one kind only those of least cost count.
    """
    L, best = results.params.step_length, dict[tuple[int, ...], tuple[float, Joint]]()
    duration = place.steps * L / place.speed
    for kind, parts in offers:
        time = sum(part.steps * L / part.speed for part in parts)
        if abs(time / duration - 1) <= wrong_time:
            cost = sum(part.steps * part.cot for part in parts) / place.steps
            if kind not in best or cost < best[kind][0]:
                best[kind] = cost, Joint(place, parts)
    highest = margin * results.costs(place.seed).get(place.speed, math.inf)
    ranked = sorted(best.values(), key=lambda pair: pair[0])[:most]
    known = results.at(place).known
    return [joint for cost, joint in ranked if cost <= highest and joint.key not in known]


def continuations(seed: int, results: SearchResults) -> list[Task]:
    """Gaits on or near the envelope, to be continued to the neighbouring speeds, both ways."""
    tasks: list[Task] = []
    envelope = results.envelope(seed)
    for here in list(results.of_seed(seed)):
        worth = worth_continuing(here, ceiling(envelope, here.place.speed))
        for speed in neighbours(results.grid, here.place.speed):
            target = here.place._replace(speed=speed)
            known = results.at(target).known
            tasks += [Continuation(target, gait) for gait in worth if gait.key not in known]
    return tasks


def neighbours(grid: Sequence[float], speed: float) -> list[float]:
    """The speeds beside one in a grid."""
    i = grid.index(speed)
    return [*grid[max(i - 1, 0) : i], *grid[i + 1 : i + 2]]


def worth_continuing(here: PlaceResults, highest: float) -> list[SearchGait]:
    """The gaits of a place that cost at most `highest`, and its best without turns."""
    near = [gait for gait in distinct(here.gaits) if gait.cot <= highest][:MOST_CONTINUED]
    swinging = [gait for gait in here.gaits if gait.turns == 0][:1]
    return near + [gait for gait in swinging if gait not in near]


def ceiling(envelope: Mapping[float, SearchGait], speed: float) -> float:
    """The cost below which a gait counts as near an envelope."""
    around = [gait.cot for v, gait in envelope.items() if abs(v - speed) <= AROUND]
    return NEAR * max(around, default=math.inf)


def distinct(gaits: Sequence[SearchGait]) -> list[SearchGait]:
    """The best gait of every family, best first."""
    best: dict[int, SearchGait] = {}
    for gait in gaits:
        best.setdefault(gait.turns, gait)
    return list(best.values())


def _lacking(
    here: PlaceResults, turns: Sequence[int], starts: int, *, outwards: bool = False
) -> list[Task]:
    """The starts that these families still lack up to a number; none if they have them."""
    lacking = [(k, here.tried(k), starts - here.tried(k)) for k in turns if here.tried(k) < starts]
    if outwards and lacking:
        return [RandomStarts(here.place, tuple(lacking), outwards)]
    return [RandomStarts(here.place, (family,)) for family in lacking]
