"""What the seeds of a row amount to. Seeds that do not walk are counted, never averaged over."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from statistics import fmean, median

from agents.statistics import bootstrap_interval, interquartile_mean
from scripts.studies.learning.cells import Cell, Result
from scripts.studies.learning.figures import Figures
from scripts.studies.learning.row import Row

#: CoT over the optimum at the same speed, minus 1; None without one.
Gap = Callable[[Row, Figures], float | None]


@dataclasses.dataclass(frozen=True)
class Average:
    """A figure over the seeds that walk.

    Attributes:
        mean: interquartile.
        low: end of the 95 % bootstrap interval.
        high: its other end.
        seeds: that have the figure.
    """

    mean: float
    low: float
    high: float
    seeds: int

    @classmethod
    def of(cls, values: Sequence[float]) -> Average | None:
        """The average of some values; None if there are none."""
        if not values:
            return None
        low, high = bootstrap_interval(values)
        return cls(interquartile_mean(values), low, high, len(values))


@dataclasses.dataclass(frozen=True)
class Line:
    """One line of a table: the same policy (best kept, last, ...) of every seed of a row.

    Attributes:
        row: of the study.
        which: what distinguishes them from the other policies of the row; may be empty.
        seeds: how many there are.
        walking: how many of them walk from enough starts.
        least: share of starts of the seed that walks from the fewest.
        middle: median share of starts.
        most: share of starts of the seed that walks from the most.
        gap: to the optimum at the learned speed; None if no seed that walks has one.
        above: the same as a difference of costs of transport.
        cot: of the seeds that walk.
        speed: of the seeds that walk (m/s).
        falls: share of all starts of all seeds that fall.
        slips: share of all starts of all seeds that take steps and slip.
        minutes: median over all seeds, of one core.
        steps: median over all seeds.
    """

    row: Row
    which: str
    seeds: int
    walking: int
    least: float
    middle: float
    most: float
    gap: Average | None
    above: Average | None
    cot: Average | None
    speed: Average | None
    falls: float
    slips: float
    minutes: float
    steps: float


@dataclasses.dataclass(frozen=True)
class Seed:
    """One policy of one seed.

    Attributes:
        row: of the study.
        which: what distinguishes it from the seed's other policies.
        seed: of its training.
        policy: how it walks.
        gap: to the optimum at its speed; None without one.
    """

    row: Row
    which: str
    seed: int
    policy: Figures
    gap: float | None


@dataclasses.dataclass(frozen=True)
class Everywhere:
    """How many seeds of a row walk from enough starts at every command.

    Attributes:
        row: of the study.
        seeds: how many there are.
        walking: how many of them walk at every command.
    """

    row: Row
    seeds: int
    walking: int


def lines(results: Mapping[Cell, Result], gap: Gap) -> list[Line]:
    """The lines of all rows, in the order of the cells."""
    found = []
    for row, own in by_row(results).items():
        for which in own[0].policies:
            found.append(_line(row, which, own, gap))
    return found


def one_by_one(results: Mapping[Cell, Result], gap: Gap) -> list[Seed]:
    """The policies of rows whose seeds are told of one by one, in the order of the cells."""
    return [
        Seed(cell.row, which, cell.seed, policy, gap(cell.row, policy))
        for cell, result in results.items()
        if cell.row.one_by_one
        for which, policy in result.policies.items()
    ]


def everywhere(results: Mapping[Cell, Result]) -> list[Everywhere]:
    """For every row, how many seeds walk in all their places."""
    return [
        Everywhere(
            row,
            len(own),
            sum(all(walks(row, each) for each in result.policies.values()) for result in own),
        )
        for row, own in by_row(results).items()
    ]


def by_row(results: Mapping[Cell, Result]) -> dict[Row, list[Result]]:
    """The results of each row's seeds."""
    found: dict[Row, list[Result]] = {}
    for cell, result in results.items():
        found.setdefault(cell.row, []).append(result)
    return found


def walks(row: Row, policy: Figures) -> bool:
    """Whether it walks from enough starts."""
    return policy.share >= row.enough - 1e-9


def _line(row: Row, which: str, results: Sequence[Result], gap: Gap) -> Line:
    policies = [result.policies[which] for result in results]
    walking = [each for each in policies if walks(row, each)]
    shares = [each.share for each in policies]
    gaps = [(each.cot, value) for each in walking if (value := gap(row, each)) is not None]
    return Line(
        row=row,
        which=which,
        seeds=len(policies),
        walking=len(walking),
        least=min(shares),
        middle=median(shares),
        most=max(shares),
        gap=Average.of([value for _, value in gaps]),
        above=Average.of([cot - cot / (1.0 + value) for cot, value in gaps if cot is not None]),
        cot=Average.of([each.cot for each in walking if each.cot is not None]),
        speed=Average.of([each.speed for each in walking if each.speed is not None]),
        falls=fmean(each.falls for each in policies),
        slips=fmean(each.slips for each in policies),
        minutes=median(result.minutes for result in results),
        steps=median(result.steps for result in results),
    )
