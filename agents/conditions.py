"""The conditions of training and evaluation: machine, disturbances, commands, control period."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from rimless_gym import RimlessWheelSpeedVectorEnv, RimlessWheelVectorEnv
from rimless_gym.checks import require_kind
from rimless_gym.envs.arguments import USUAL, Control
from rimless_gym.envs.disturbances import Disturbances, Ranges, as_disturbances, as_ranges
from rimless_gym.envs.task import Task
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE, Machine, as_params


@dataclasses.dataclass(frozen=True)
class Conditions:
    """A machine, the ranges of its parameters, the disturbances, and how it is controlled.

    Attributes:
        params: the machine.
        ranges: of the parameters that are drawn anew for every episode.
        disturbances: pushes, sensor noise and delay.
        control: how long an action is held, and between which speeds one is commanded, if any.

    Raises:
        TypeError: `params` is not a `WheelParams`, or `control` not a `Control`.
        ValueError: an end of a range is not valid for the machine, or actions are currents.
    """

    params: WheelParams = BUILDABLE
    ranges: Ranges = dataclasses.field(default_factory=lambda: Ranges({}))
    disturbances: Disturbances = dataclasses.field(default_factory=Disturbances)
    control: Control = USUAL

    def __post_init__(self) -> None:
        require_kind("params", self.params, WheelParams)
        require_kind("control", self.control, Control)
        self.ranges.require_valid([self.params])
        if self.control.by_current:
            raise ValueError("actions = 'current': policies here command voltages")

    @classmethod
    def of(
        cls,
        params: Machine,
        ranges: Ranges | Mapping[str, Any] | None,
        disturbances: Disturbances | Mapping[str, Any] | None,
        speeds: tuple[float, float] | None = None,
        control_period: float | None = None,
    ) -> Conditions:
        """Conditions from what the environment takes.

        Without a `control_period`, it is that of the environment: `RimlessWheelSpeed-v0` if there
        are speeds to be commanded, otherwise `RimlessWheel-v0`.

        Raises:
            TypeError: a value is of the wrong kind.
            ValueError: a name is unknown, or a number is out of its range.
        """
        if control_period is None:
            control_period = _kind(speeds is not None).default_period
        control = Control(control_period, speeds=speeds)
        return cls(as_params(params), as_ranges(ranges), as_disturbances(disturbances), control)

    @property
    def commanded(self) -> bool:
        """Whether a speed is commanded, as in `RimlessWheelSpeed-v0`."""
        return self.control.speeds is not None

    @property
    def default_task(self) -> Task:
        """The reward of the environment, unless another is given."""
        return _kind(self.commanded).default_task

    def envs(self, num_envs: int, **arguments: Any) -> RimlessWheelVectorEnv:
        """A vector environment of these conditions; `arguments` add to them or replace them."""
        own: dict[str, Any] = {
            "params": self.params,
            "ranges": self.ranges,
            "disturbances": self.disturbances,
            "control_period": self.control.period,
        }
        if self.commanded:
            own["speeds"] = self.control.speeds
        return _kind(self.commanded)(num_envs, **(own | arguments))

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values; ranges and disturbances are None where there are none."""
        undisturbed = self.disturbances == Disturbances()
        speeds = self.control.speeds
        return {
            "params": self.params.to_dict(),
            "ranges": {name: list(pair) for name, pair in self.ranges.bounds.items()} or None,
            "disturbances": None if undisturbed else dataclasses.asdict(self.disturbances),
            "speeds": None if speeds is None else list(speeds),
            "control_period": self.control.period,
        }


def require_usual(algo: str, conditions: Conditions) -> None:
    """Refuse drawn machines, disturbances, commanded speeds, and other control periods."""
    if conditions.ranges.bounds or conditions.disturbances != Disturbances():
        raise ValueError(
            f"algo = {algo!r}: walks on the nominal machine without disturbances; leave out "
            "ranges and disturbances, or choose another learner"
        )
    if conditions.control != USUAL:
        raise ValueError(
            f"algo = {algo!r}: holds a voltage for {USUAL.period:g} s, and no speed is "
            "commanded; leave out speeds and control_period, or choose another learner"
        )


def _kind(commanded: bool) -> type[RimlessWheelVectorEnv]:
    return RimlessWheelSpeedVectorEnv if commanded else RimlessWheelVectorEnv
