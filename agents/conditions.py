"""The machine that walks, and what varies and disturbs it, in training and in evaluation alike."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from rimless_gym import RimlessWheelSpeedVectorEnv, RimlessWheelVectorEnv
from rimless_gym.checks import require_kind
from rimless_gym.envs.disturbances import Disturbances, Ranges, as_disturbances, as_ranges
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE, Machine, as_params


@dataclasses.dataclass(frozen=True)
class Conditions:
    """A machine, the ranges of its parameters, and the disturbances.

    Attributes:
        params: the machine.
        ranges: of the parameters that are drawn anew for every episode.
        disturbances: pushes, sensor noise and delay.

    Raises:
        TypeError: `params` is not a `WheelParams`.
        ValueError: an end of a range is not valid for the machine.
    """

    params: WheelParams = BUILDABLE
    ranges: Ranges = dataclasses.field(default_factory=lambda: Ranges({}))
    disturbances: Disturbances = dataclasses.field(default_factory=Disturbances)

    def __post_init__(self) -> None:
        require_kind("params", self.params, WheelParams)
        self.ranges.require_valid(self.params)

    @classmethod
    def of(
        cls,
        params: Machine,
        ranges: Ranges | Mapping[str, Any] | None,
        disturbances: Disturbances | Mapping[str, Any] | None,
    ) -> Conditions:
        """Conditions from machine, ranges and disturbances as the environment takes them.

        Raises:
            TypeError: a value is of the wrong kind.
            ValueError: a name is unknown, or a number is out of its range.
        """
        return cls(as_params(params), as_ranges(ranges), as_disturbances(disturbances))

    def envs(self, num_envs: int, **arguments: Any) -> RimlessWheelVectorEnv:
        """A vector environment of these conditions; `arguments` are any others that it takes."""
        return RimlessWheelVectorEnv(
            num_envs,
            self.params,
            ranges=self.ranges,
            disturbances=self.disturbances,
            **arguments,
        )

    def speed_envs(self, num_envs: int, **arguments: Any) -> RimlessWheelSpeedVectorEnv:
        """The same of `RimlessWheelSpeed-v0`, in which a speed is commanded."""
        return RimlessWheelSpeedVectorEnv(
            num_envs,
            self.params,
            ranges=self.ranges,
            disturbances=self.disturbances,
            **arguments,
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values; ranges and disturbances are None where there are none."""
        undisturbed = self.disturbances == Disturbances()
        return {
            "params": self.params.to_dict(),
            "ranges": {name: list(pair) for name, pair in self.ranges.bounds.items()} or None,
            "disturbances": None if undisturbed else dataclasses.asdict(self.disturbances),
        }
