"""Find the prototype's gaits, or go on finding them; then write the results and the page."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from tqdm import tqdm

from scripts.studies.thesis.prototype import page
from scripts.studies.thesis.prototype.ends import ends
from scripts.studies.thesis.prototype.points import Point
from scripts.studies.thesis.prototype.study import improved, shared, study
from scripts.studies.thesis.prototype.variant import SCALES, VARIANTS

#: Most sweeps of improvement.
SWEEPS = 2


def campaign(folder: Path, workers: int, docs: Path | None) -> None:
    """Find the gaits of every supply and scale, and print their table.

    Args:
        folder: of the results and the points.
        workers: processes.
        docs: page to put the table and figure into, if any.
    """
    points = _searched(folder, workers)
    for sweep in range(1, SWEEPS + 1):
        points, better = _swept(folder, points, workers, sweep)
        if not better:
            break
    order = {variant.name: i for i, variant in enumerate(VARIANTS)}
    points = shared(sorted(points, key=lambda p: (order[p.variant.name], -p.scale)))
    found = page.results(points, ends(points))
    page.write(found, folder)
    if docs:
        page.refresh(docs, found, points)
    print(page.table(found))
    print(f"{len(points)} points: see {folder / 'prototype.png'}")


def _searched(folder: Path, workers: int) -> list[Point]:
    """Every point, searched for from large pendulums down."""
    points: list[Point] = []
    with (
        tqdm(total=len(VARIANTS) * len(SCALES), desc="searching") as bar,
        closing(study(folder, workers=workers)) as found,
    ):
        for point in found:
            points.append(point)
            bar.set_postfix_str(f"{point.variant.name}, scale {point.scale:g}", refresh=False)
            bar.update()
    return points


def _swept(folder: Path, points: list[Point], workers: int, sweep: int) -> tuple[list[Point], int]:
    """The points after a sweep of improvement, and how many became better."""
    better, after = 0, []
    with (
        tqdm(total=len(points), desc=f"improving, sweep {sweep} of {SWEEPS}") as bar,
        closing(improved(folder, points, workers=workers)) as others,
    ):
        for point, changed in others:
            after.append(point)
            better += changed
            bar.set_postfix_str(f"{better} better", refresh=False)
            bar.update()
    return after, better
