"""The clock of a held gait: its voltage changes at ticks, and it is optimal only in step with them.

A deviation across the orbit says nothing about time. How far a state is ahead of the clock is one
more coordinate, which some laws correct.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import inner
from trajopt.feedback.orbit import between
from trajopt.gaits.solution import Solution


class Clock(NamedTuple):
    """Ticks at tick + k hold of the gait's own time, for all whole k.

    Attributes:
        hold: period (s).
        tick: time of one tick (s).
    """

    hold: float
    tick: float

    @classmethod
    def of(cls, solution: Solution) -> Clock:
        """The clock of a gait; that of one with a continuous voltage is of no use."""
        if solution.hold is None:
            return cls(CONTROL_PERIOD, 0.0)
        return cls(solution.hold, solution.first_tick)


@inner
def ahead_of_clock(spot, times, clock):  # type: ignore[no-untyped-def]
    """Time (s) by which a state at a spot of the orbit is ahead of the nearest tick.

    A sine, which is the time near a tick and has no jump half way between two.

    Args:
        spot: where on the orbit the state is.
        times: of the orbit's nodes (s), shape (n,).
        clock: the gait's.
    """
    turn = 2 * np.pi / clock.hold
    return np.sin(turn * (between(times, spot) - clock.tick)) / turn
