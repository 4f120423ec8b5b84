"""Whether the machine as built can walk: its gaits, followed from larger pendulums down.

A point is the cheapest gait of a supply and a scale of the pendulum. The scales of a supply are
searched one after the other, from large to small; then gaits of neighbours are led to each point,
and replace its own if they cost less. Every point is stored as soon as it is found.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rimless_gym.presets import THESIS_PHYSICAL
from scripts.studies.documents import markdown
from scripts.studies.thesis.variants import (
    SCALES,
    VARIANTS,
    Variant,
    cheaper,
    cheapest,
)
from trajopt.gaits.library import shipped
from trajopt.gaits.solution import Solution
from trajopt.ocp.ranking import least_first
from trajopt.pool import run
from trajopt.provenance import provenance
from trajopt.store import Store, write_text

#: Most rounds of improvement.
ROUNDS = 2

#: The scales of the page's table; results.json has all.
SHOWN = (4.0, 3.0, 2.0, 1.6, 1.3, 1.15, 1.0)

COLUMNS = (
    *("supply", "scale", "CoT", "speed (m/s)", "turns", "gear", "least Fy / weight"),
    *("friction demand", "peak V", "clearance (m)", "state error"),
)

MARKS = markdown.marks("thesis", ("prototype",))


@dataclasses.dataclass(frozen=True)
class Point:
    """The cheapest gait of a supply and scale.

    Attributes:
        variant: supply and gear.
        scale: of the pendulum.
        gait: verified; None if none was found.
        reason: why none was found.
    """

    variant: Variant
    scale: float
    gait: Solution | None
    reason: str = ""

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
    """Find the gaits of every supply and scale, and print their table.

    Args:
        folder: of the results and the points.
        workers: processes.
        docs: docs/thesis.md, to put the table into, if given.
    """
    with Store(folder, provenance()) as store:
        points = searched(store, VARIANTS, SCALES, workers)
        for number in range(1, ROUNDS + 1):
            tasks = [(point, neighbours(point, points)) for point in points]
            title = f"improving, round {number} of {ROUNDS}"
            better = [point for _, point in run(improved, tasks, workers, progress=title) if point]
            for point in better:
                save(store, point)
            changed = {(point.variant, point.scale): point for point in better}
            points = [changed.get((point.variant, point.scale), point) for point in points]
            if not better:
                break
    points = shared(points)
    results = {
        "gaits": [point.row() for point in points],
        "provenance": provenance(),
    }
    write(results, folder)
    if docs:
        write(results, docs.parent / "figures" / "prototype")
        for point in points:
            if point.gait is not None and point.scale == SCALES[-1]:
                name = f"as_built_{point.variant.file_name}.npz"
                point.gait.save(docs.parent / "figures" / "prototype" / name)
        markdown.refresh(docs, MARKS, {"prototype": table(results)})
    print(table(results))


def searched(
    store: Store, variants: Sequence[Variant], scales: Sequence[float], workers: int | None = None
) -> list[Point]:
    """Every point, from the largest pendulum down, the supplies side by side.

    Some starts of each scale are the gaits of the two scales before it. For the first scale these
    are the cheapest shipped gaits.
    """
    points: dict[tuple[Variant, float], Point] = {}
    known = {variant: first_gaits() for variant in variants}
    for scale in scales:
        tasks = []
        for variant in variants:
            point = load(store, variant, scale)
            if point is None:
                tasks.append((variant, scale, known[variant]))
            else:
                points[variant, scale] = point
        for _, point in run(_searched, tasks, workers, progress=f"searching, scale {scale:g}"):
            save(store, point)
            points[point.variant, scale] = point
        for variant in variants:
            gait = points[variant, scale].gait
            if gait is not None:
                known[variant] = (gait, *known[variant])[:2]
    return [points[variant, scale] for variant in variants for scale in scales]


def _searched(task: tuple[Variant, float, tuple[Solution, ...]]) -> Point:
    variant, scale, known = task
    return Point(variant, scale, *cheapest(variant, scale, known))


def first_gaits() -> tuple[Solution, ...]:
    """The cheapest shipped gaits of one step: their machine is that of the largest scale."""
    known = [gait for gait in shipped() if gait.steps == 1 and gait.params == THESIS_PHYSICAL]
    return tuple(least_first(known, lambda gait: gait.cot)[:2])


def improved(task: tuple[Point, Sequence[Solution]]) -> Point | None:
    """A point with a cheaper gait, continued from one of its neighbours'; None if none is."""
    point, known = task
    best = point.gait.cot if point.gait else math.inf
    gait = cheaper(point.variant, point.scale, best, known)
    return None if gait is None else Point(point.variant, point.scale, gait)


def neighbours(point: Point, points: Sequence[Point]) -> list[Solution]:
    """Gaits that might lead to a cheaper one at a point.

    These are of the next scales of the same supply, and of the same scale of supplies whose gaits
    this one admits; for the largest pendulum also shipped gaits.
    """
    scales = sorted({p.scale for p in points if p.variant == point.variant and p.gait})
    below = [scale for scale in scales if scale < point.scale][-1:]
    above = [scale for scale in scales if scale > point.scale][:1]
    beginning = [] if above else list(first_gaits())
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
            params = gait.params.replace(voltage_limit=point.variant.voltage)
            point = Point(point.variant, point.scale, dataclasses.replace(gait, params=params))
        best.append(point)
    return best


def key_of(variant: Variant, scale: float) -> str:
    """The key of a point in the store."""
    return f"{variant.file_name}/{scale:.3f}"


def save(store: Store, point: Point) -> None:
    """Store a point."""
    key, files = key_of(point.variant, point.scale), []
    if point.gait is not None:
        path = store.folder / f"{key}_gait.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        point.gait.save(path)
        files.append(f"{key}_gait.npz")
    store.save(key, {"reason": point.reason, "gait": bool(files)}, files)


def load(store: Store, variant: Variant, scale: float) -> Point | None:
    """A stored point; None if it is missing."""
    key = key_of(variant, scale)
    if key not in store:
        return None
    stored = store.load(key)
    gait = Solution.load(store.folder / f"{key}_gait.npz") if stored["gait"] else None
    return Point(variant, scale, gait, stored["reason"])


def write(results: dict[str, Any], folder: Path) -> None:
    """Write results.json into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "results.json", json.dumps(results, indent=1, allow_nan=False) + "\n")


def table(results: dict[str, Any]) -> str:
    """A row per gait."""
    walking = [row for row in results["gaits"] if row["cot"] and row["scale"] in SHOWN]
    return markdown.table(COLUMNS, map(_cells, walking)) + "\n"


def _cells(row: dict[str, Any]) -> list[str]:
    return [
        row["variant"],
        f"{row['scale']:g}",
        f"{row['cot']:.4f}",
        f"{row['speed']:.3f}",
        f"{row['theta_turns']:d}",
        f"{row['gear']:.3f}",
        f"{row['min_normal_force_over_weight']:.2f}",
        f"{row['max_friction_demand']:.2f}",
        f"{row['peak_voltage']:.1f}",
        f"{row['clearance']:.2f}",
        f"{row['state_error']:.0e}",
    ]
