"""A point of the study, which is the cheapest gait of a supply and scale, and its file."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

from scripts.studies.thesis.prototype.limits import binding
from scripts.studies.thesis.prototype.variant import Variant
from trajopt.files import write_text
from trajopt.gaits.solution import Solution


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
            "binding": binding(self.gait),
        }


def place(folder: Path, variant: Variant, scale: float, suffix: str) -> Path:
    """Path of a point's file: .npz with its gait, or .json with the reason why there is none."""
    return folder / variant.file_name / f"{scale:.3f}{suffix}"


def stored(folder: Path, variant: Variant, scale: float) -> Point | None:
    """The point in a file, or None if it has no file."""
    gait, nothing = (place(folder, variant, scale, suffix) for suffix in (".npz", ".json"))
    if gait.exists():
        return Point(variant, scale, Solution.load(gait))
    if nothing.exists():
        return Point(variant, scale, None, json.loads(nothing.read_text())["reason"])
    return None


def store(folder: Path, point: Point) -> None:
    """Save a point."""
    gait, nothing = (
        place(folder, point.variant, point.scale, suffix) for suffix in (".npz", ".json")
    )
    gait.parent.mkdir(parents=True, exist_ok=True)
    if point.gait is not None:
        point.gait.save(gait)
        nothing.unlink(missing_ok=True)
    else:
        write_text(nothing, json.dumps({"reason": point.reason}) + "\n")
