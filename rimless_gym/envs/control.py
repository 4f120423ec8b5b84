"""How an agent and a wheel talk: how long an action is held, and what it commands."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from rimless_gym.checks import real, real_array
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.envs.observation import (
    COMMANDED_BOUND,
    COMMANDED_SIZE,
    MOST_SPEED,
    OBSERVATION_BOUND,
    OBSERVATION_SIZE,
)
from rimless_gym.hybrid import CONTROL_PERIOD

#: What an action may be: a voltage, or the motor's current.
ACTIONS = ("voltage", "current")

#: Most ticks of 10 ms in a control interval.
MOST_TICKS = 10


@dataclasses.dataclass(frozen=True)
class Control:
    """What an environment keeps for good: it cannot be changed between episodes.

    Attributes:
        period: length of a control interval (s), a whole multiple of 10 ms up to 100 ms.
        actions: what an action commands, one of `ACTIONS`.
        speeds: least and greatest speed (m/s) between which each episode draws the one that is
            commanded; None where none is.

    Raises:
        TypeError: a value has the wrong type.
        ValueError: the period is no such multiple, the actions are unknown, or the speeds are not
            in order or out of their range.
    """

    period: float = CONTROL_PERIOD
    actions: str = "voltage"
    speeds: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        period = real("control_period", self.period)
        ticks = round(period / CONTROL_PERIOD)
        if not (1 <= ticks <= MOST_TICKS and abs(period - ticks * CONTROL_PERIOD) < 1e-9):
            raise ValueError(
                f"control_period = {period:g} s: must be a whole multiple of {CONTROL_PERIOD:g} s, "
                f"from {CONTROL_PERIOD:g} to {MOST_TICKS * CONTROL_PERIOD:g}"
            )
        if self.actions not in ACTIONS:
            raise ValueError(f"actions = {self.actions!r}: choose from {ACTIONS}")
        object.__setattr__(self, "period", ticks * CONTROL_PERIOD)
        if self.speeds is not None:
            least, greatest = as_speeds("speeds", self.speeds, 2).tolist()
            if least > greatest:
                raise ValueError(f"speeds = {self.speeds}: must be in order, the least first")
            object.__setattr__(self, "speeds", (least, greatest))

    @property
    def ticks(self) -> int:
        """Length of a control interval, in units of 10 ms."""
        return round(self.period / CONTROL_PERIOD)

    @property
    def by_current(self) -> bool:
        """Whether an action is the motor's current."""
        return self.actions == "current"

    @property
    def width(self) -> int:
        """Size of an observation."""
        return OBSERVATION_SIZE if self.speeds is None else COMMANDED_SIZE

    def action_space(self) -> spaces.Space[NDArray[np.float32]]:
        """The space of one action."""
        return spaces.Box(-1.0, 1.0, (1,), np.float32)

    def observation_space(self) -> spaces.Space[NDArray[np.float32]]:
        """The space of one observation."""
        bound = OBSERVATION_BOUND if self.speeds is None else COMMANDED_BOUND
        return spaces.Box(-bound, bound)

    @property
    def episode_steps(self) -> int:
        """The number of intervals that make 20 s, rounded up."""
        return -(-EPISODE_STEPS // self.ticks)


#: A voltage, held for 10 ms.
USUAL = Control()


def as_speeds(name: str, speeds: Any, n: int) -> NDArray[np.float64]:
    """Speeds that may be commanded (m/s), one for all or one each, as a new array (N,).

    Raises:
        TypeError: they are not real numbers.
        ValueError: there is not one for each, or one is out of its range.
    """
    given = real_array(name, speeds)
    if given.shape not in ((), (n,)):
        raise ValueError(f"{name} = {speeds!r}: give one number, or {n}, not {given.shape}")
    each = np.zeros(n) + given
    if not ((each > 0.0) & (each <= MOST_SPEED)).all():
        raise ValueError(
            f"{name} = {speeds!r}: must be greater than 0 and at most {MOST_SPEED:g} m/s"
        )
    return each
