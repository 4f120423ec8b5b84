"""Whether the machine as built can walk: its gaits, followed from larger pendulums down.

A point is the cheapest gait of a supply and a scale of the pendulum. The scales of a supply are
searched one after the other, from large to small; then gaits of neighbours are led to each point,
and replace its own if they cost less. Every point is stored as soon as it is found.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rimless_gym.presets import THESIS_PHYSICAL
from scripts.studies.designed_gaits import gaits_of, stage
from scripts.studies.documents import markdown
from scripts.studies.thesis.variants import SCALES, VARIANTS, Variant, cheaper, cheapest
from trajopt.gaits.library import shipped
from trajopt.gaits.solution import Solution
from trajopt.ocp.ranking import least_first
from trajopt.provenance import provenance
from trajopt.store import Store, write_text

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
            tasks = {point.key: (point, neighbours(point, points)) for point in points}
            better = gaits_of(run(f"round {number} of {ROUNDS}", tasks, improved))
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
    """Every point, from the largest pendulum down, the supplies side by side.

    Some starts of each scale are the gaits of the two scales before it. For the first scale these
    are the cheapest shipped gaits.
    """
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


def improved(point: Point, known: Sequence[Solution]) -> Solution | None:
    """A gait cheaper than a point's, continued from one of its neighbours'; None if none is."""
    best = point.gait.cot if point.gait else math.inf
    return cheaper(point.variant, point.scale, best, known)


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


def write(results: dict[str, Any], folder: Path) -> None:
    """Write results.json into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "results.json", json.dumps(results, indent=1, allow_nan=False) + "\n")


def table(results: dict[str, Any]) -> str:
    """A row per gait."""
    walking = [row for row in results["gaits"] if row["cot"] and row["scale"] in SHOWN]
    return markdown.formatted(COLUMNS, walking) + "\n"
