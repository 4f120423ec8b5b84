"""The clock of a held gait: its voltage changes at ticks, and it is optimal only in step with them.

A deviation across the orbit says nothing about time. How far a state is ahead of the clock is one
more coordinate, which some laws correct. They need no memory for it: the clock is the control
period, at whose ends they are asked. So only a gait that is held for a control period has a clock
here; one with a continuous voltage, or held for another time, has none, and to be ahead costs
nothing.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rimless_gym.checks import positive
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import inner
from trajopt.feedback.orbit import Spot, between, deviation, located
from trajopt.gaits.solution import Solution


class Clock(NamedTuple):
    """Ticks at tick + k `CONTROL_PERIOD` of the gait's own time, for all whole k.

    Attributes:
        tick: time of one tick (s).
        ahead: time (s) ahead of a tick that counts like one standard deviation of the gait's own
            motion; infinite without a clock: time does not count.
    """

    tick: float
    ahead: float

    @classmethod
    def of(cls, solution: Solution, ahead: float | None) -> Clock:
        """The clock of a gait.

        Args:
            solution: the gait.
            ahead: time (s) that counts like one standard deviation; > 0. None: it does not count,
                as if the gait had no clock.

        Raises:
            TypeError: `ahead` is not a number.
            ValueError: it is not finite and positive.
        """
        counts = math.inf if ahead is None else positive("ahead", ahead)
        return cls(solution.first_tick, counts) if has_clock(solution) else cls(0.0, math.inf)


def has_clock(solution: Solution) -> bool:
    """Whether the gait's voltage is held for a control period."""
    return solution.hold is not None and math.isclose(solution.hold, CONTROL_PERIOD)


class Offset(NamedTuple):
    """How far from a held gait a state is.

    Attributes:
        spot: the nearest point of the orbit.
        across: deviation from that point, four numbers.
        early: time (s) by which that point is ahead of the nearest tick.
    """

    spot: Spot
    across: tuple[float, float, float, float]
    early: float


@inner
def offset(x, orbit, clock):  # type: ignore[no-untyped-def]
    """The `Offset` of a state."""
    spot = located(x, orbit)
    across = deviation(x, between(orbit.states, spot))
    return Offset(spot, across, ahead_of_clock(spot, orbit.times, clock))


@inner
def ahead_of_clock(spot, times, clock):  # type: ignore[no-untyped-def]
    """Time (s) by which a state at a spot of the orbit is ahead of the nearest tick.

    A sine, which is the time near a tick and has no jump half way between two.

    Args:
        spot: where on the orbit the state is.
        times: of the orbit's nodes (s), shape (n,).
        clock: the gait's.
    """
    turn = 2 * np.pi / CONTROL_PERIOD
    return np.sin(turn * (between(times, spot) - clock.tick)) / turn
