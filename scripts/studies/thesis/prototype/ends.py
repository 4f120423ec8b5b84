"""How the gaits of a supply end where its pendulum becomes too small."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from scripts.studies.thesis.prototype.gait import followed
from scripts.studies.thesis.prototype.points import Point

#: The scale to which the last gait is followed, if it does not end before.
FARTHEST = 0.5


@dataclasses.dataclass(frozen=True)
class End:
    """How far the last gait of a supply can be followed to smaller pendulums.

    Attributes:
        variant: its name.
        scales: along the curve.
        costs: of transport, on a coarse mesh.
        obstacle: what stopped it, in words; empty if nothing did.
    """

    variant: str
    scales: tuple[float, ...]
    costs: tuple[float, ...]
    obstacle: str


def ends(points: Sequence[Point]) -> list[End]:
    """The ends of all supplies that have no gait for their smallest pendulum."""
    found = []
    for variant in dict.fromkeys(point.variant for point in points):
        own = [point for point in points if point.variant == variant]
        walking = [point for point in own if point.gait is not None]
        if walking and min(own, key=_scale).gait is None:
            found.append(_end(min(walking, key=_scale)))
    return found


def _scale(point: Point) -> float:
    return point.scale


def _end(point: Point) -> End:
    """Follow a gait to smaller pendulums until something stops it."""
    gait, variant = point.gait, point.variant
    assert gait is not None
    curve = followed(variant, gait, FARTHEST)
    obstacle = str(curve.obstacle) if curve.obstacle else ""
    return End(variant.name, curve.values, curve.costs, obstacle)
