"""How often episodes begin at rest, moving, or with a whirling pendulum."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from rimless_gym.checks import not_negative
from rimless_gym.envs.plain import made_of


@dataclasses.dataclass(frozen=True)
class Starts:
    """Shares of the kinds of start that are drawn; what counts is their size to each other.

    Attributes:
        rest: at rest on two feet, the pendulum near hanging.
        moving: in single stance, the pendulum anywhere and slow.
        whirling: in single stance, the pendulum anywhere and turning at 6 to 16 rad/s, in either
            sense. Cheap gaits whirl; from the other starts, an untrained policy hardly ever does.

    Raises:
        TypeError: a share is not a number.
        ValueError: a share is negative or not finite, or all are 0.
    """

    rest: float = 0.25
    moving: float = 0.75
    whirling: float = 0.0

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            object.__setattr__(self, name, not_negative(name, value))
        if not self.rest + self.moving + self.whirling > 0.0:
            raise ValueError(f"{self}: one of the shares must be greater than 0")

    @property
    def bounds(self) -> tuple[float, float]:
        """What a number in [0, 1) must be below for rest, and at least for whirling."""
        total = self.rest + self.moving + self.whirling
        return self.rest / total, 1.0 - self.whirling / total


#: One start in four at rest, none whirling.
USUAL_STARTS = Starts()


def as_starts(starts: Starts | Mapping[str, Any] | None) -> Starts:
    """Shares, given as such or as a mapping of their fields; None for the usual ones.

    Raises:
        TypeError: it is neither.
        ValueError: a share is unknown or out of range.
    """
    if isinstance(starts, Mapping):
        return made_of(Starts, "starts", starts)
    if not isinstance(starts, Starts | None):
        raise TypeError(
            f"starts = {starts!r}: give a rimless_gym.Starts or a dictionary of its fields"
        )
    return starts or USUAL_STARTS
