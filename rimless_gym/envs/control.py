"""How an agent and a wheel talk: how long an action is held, and what it commands."""

from __future__ import annotations

import dataclasses

from rimless_gym.checks import real
from rimless_gym.envs import EPISODE_STEPS
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

    Raises:
        TypeError: a value has the wrong type.
        ValueError: the period is no such multiple, or the actions are unknown.
    """

    period: float = CONTROL_PERIOD
    actions: str = "voltage"

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

    @property
    def ticks(self) -> int:
        """Length of a control interval, in units of 10 ms."""
        return round(self.period / CONTROL_PERIOD)

    @property
    def by_current(self) -> bool:
        """Whether an action is the motor's current."""
        return self.actions == "current"

    @property
    def episode_steps(self) -> int:
        """The number of intervals that make 20 s, rounded up."""
        return -(-EPISODE_STEPS // self.ticks)


#: A voltage, held for 10 ms.
USUAL = Control()
