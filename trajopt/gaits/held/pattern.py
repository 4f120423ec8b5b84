"""In which control intervals of a stride the touchdowns fall."""

from __future__ import annotations

import dataclasses

import numpy as np

from trajopt.ocp.arrays import Array, Indices


@dataclasses.dataclass(frozen=True)
class Pattern:
    """The control intervals of a stride that begins and ends with a touchdown.

    Every touchdown splits an interval. The one at the stride's end splits the same interval as the
    one at its start, so that the stride lasts a whole number of intervals.

    Attributes:
        hold: length of an interval (s).
        whole: for every step, how many intervals lie between its two touchdowns, >= 0.
    """

    hold: float
    whole: tuple[int, ...]

    @classmethod
    def around(cls, hold: float, touchdowns: Array, lead: float) -> Pattern:
        """The pattern of a stride with given touchdowns.

        Args:
            hold: s.
            touchdowns: times (s), the first 0 and the last a multiple of `hold`, (steps + 1,).
            lead: time (s) of the first tick after the first touchdown, in (0, hold).
        """
        passed = np.ceil((touchdowns - lead) / hold).astype(int)  # ticks before each touchdown
        passed[-1] = round(touchdowns[-1] / hold)
        whole = np.maximum(np.diff(passed) - 1, 0)
        whole[np.argmax(whole)] += passed[-1] - (whole.sum() + len(whole))
        return cls(hold, tuple(whole.tolist()))

    @property
    def steps(self) -> int:
        """Touchdowns per stride."""
        return len(self.whole)

    @property
    def ticks(self) -> int:
        """Control intervals per stride."""
        return sum(self.whole) + self.steps

    def voltages_of(self, step: int) -> Indices:
        """Which of the stride's voltages act in a step, shape (whole + 2,).

        Voltage 0 is held in the interval that the stride's first touchdown splits.
        """
        first = sum(self.whole[:step]) + step
        return np.arange(first, first + self.whole[step] + 2) % self.ticks

    def edges_of(self, step: int, shares: Array) -> Array:
        """Times from a step's start (s) of its touchdowns and the ticks between, (whole + 3,).

        Args:
            step: its index.
            shares: how much of each split interval lies before its touchdown, in (0, 1), shape
                (steps,). They belong to the touchdowns that end the steps.
        """
        lengths = np.ones(self.whole[step] + 2)
        lengths[0], lengths[-1] = 1.0 - shares[step - 1], shares[step]
        return np.concatenate([[0.0], np.cumsum(lengths)]) * self.hold

    def moved(self, step: int, intervals: int) -> Pattern | None:
        """The pattern with the touchdown that ends a step `intervals` later; None if impossible."""
        whole = list(self.whole)
        whole[step] += intervals
        whole[(step + 1) % self.steps] -= intervals
        return dataclasses.replace(self, whole=tuple(whole)) if min(whole) >= 0 else None
