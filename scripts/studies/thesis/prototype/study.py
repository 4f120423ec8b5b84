"""The study's sweeps over scales and supplies: from large pendulums down, then from neighbours."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, as_completed, wait
from pathlib import Path
from typing import Any

from rimless_gym.presets import THESIS_PHYSICAL
from scripts.studies.thesis.prototype.gait import cheaper, cheapest
from scripts.studies.thesis.prototype.points import Point, store, stored
from scripts.studies.thesis.prototype.variant import SCALES, VARIANTS, Variant
from trajopt.gaits.library import shipped
from trajopt.gaits.solution import Solution
from trajopt.ocp.ranking import least_first
from trajopt.processes import Submit, pool


def study(
    folder: Path,
    *,
    variants: Sequence[Variant] = VARIANTS,
    scales: Sequence[float] = SCALES,
    workers: int = 1,
) -> Generator[Point, None, None]:
    """Yield every point, from the largest pendulum down; those in the folder at once.

    Some starts of each scale are the gaits of the scales before it. For the first scale these are
    the cheapest shipped gaits.

    Args:
        folder: where points are kept.
        variants: supplies, followed side by side.
        scales: of the pendulum, from large to small.
        workers: processes.
    """
    chains = [_Chain(variant, list(scales), _first()) for variant in variants]
    waiting: dict[Future[tuple[Solution | None, str]], _Chain] = {}
    with pool(workers) as submit:
        for chain in chains:
            yield from chain.recalled(folder)
            chain.ask(submit, waiting)
        while waiting:
            done, _ = wait(waiting, return_when=FIRST_COMPLETED)
            for future in done:
                chain = waiting.pop(future)
                point = Point(chain.variant, chain.left.pop(0), *future.result())
                store(folder, point)
                chain.add(point)
                yield point
                yield from chain.recalled(folder)
                chain.ask(submit, waiting)


def _first() -> tuple[Solution, ...]:
    """The cheapest shipped gaits of one step: their machine is that of the largest scale."""
    known = [gait for gait in shipped() if gait.steps == 1 and gait.params == THESIS_PHYSICAL]
    return tuple(least_first(known, lambda gait: gait.cot)[:2])


@dataclasses.dataclass
class _Chain:
    """The scales of a supply that are still to be searched, and the gaits to start from."""

    variant: Variant
    left: list[float]
    known: tuple[Solution, ...] = ()

    def recalled(self, folder: Path) -> Iterator[Point]:
        """The next points, for as long as they are in the folder."""
        while self.left and (point := stored(folder, self.variant, self.left[0])):
            self.left.pop(0)
            self.add(point)
            yield point

    def add(self, point: Point) -> None:
        """Start from this point's gait and the one before it from now on."""
        if point.gait is not None:
            self.known = (point.gait, *self.known)[:2]

    def ask(self, submit: Submit, waiting: dict[Future[Any], _Chain]) -> None:
        """Submit the search for the next point."""
        if self.left:
            waiting[submit(cheapest, self.variant, self.left[0], self.known)] = self


def improved(
    folder: Path, points: Sequence[Point], *, workers: int = 1
) -> Generator[tuple[Point, bool], None, None]:
    """Yield every point, and whether a gait led to it from a neighbour made it cheaper.

    Neighbours are the next scales of the same supply, and the same scale of supplies whose gaits
    this one admits; for the largest pendulum also shipped gaits. A cheaper gait replaces the old
    one in the folder.
    """
    with pool(workers) as submit:
        futures = {submit(_improved, p, _neighbours(p, points)): p for p in points}
        for future in as_completed(futures):
            point, gait = futures[future], future.result()
            if gait is not None:
                point = Point(point.variant, point.scale, gait)
                store(folder, point)
            yield point, gait is not None


def shared(points: Sequence[Point]) -> list[Point]:
    """The points, each with the cheapest gait of its own supply and those whose gaits it admits."""
    best = []
    for point in points:
        lesser = [
            other.gait
            for other in points
            if other.gait is not None
            and other.scale == point.scale
            and point.variant.admits(other.variant)
        ]
        if lesser:
            gait = least_first(lesser, lambda gait: gait.cot)[0]
            own = gait.params.replace(voltage_limit=point.variant.voltage)
            best.append(Point(point.variant, point.scale, dataclasses.replace(gait, params=own)))
        else:
            best.append(point)
    return best


def _improved(point: Point, known: Sequence[Solution]) -> Solution | None:
    best = point.gait.cot if point.gait else math.inf
    return cheaper(point.variant, point.scale, best, known)


def _neighbours(point: Point, points: Sequence[Point]) -> list[Solution]:
    """Gaits that might lead to a cheaper one at a point."""
    own = sorted({p.scale for p in points if p.variant == point.variant and p.gait})
    below = [scale for scale in own if scale < point.scale][-1:]
    above = [scale for scale in own if scale > point.scale][:1]
    beginning = [] if above else list(_first())
    return beginning + [
        p.gait
        for p in points
        if p.gait is not None
        and (
            (p.variant == point.variant and p.scale in below + above)
            or (p.variant != point.variant and p.scale == point.scale)
        )
        and point.variant.admits(p.variant)
    ]
