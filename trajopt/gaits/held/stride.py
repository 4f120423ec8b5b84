"""A stride under a held voltage, as the optimisation sees it."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator

import numpy as np

from trajopt.gaits.held.pattern import Pattern
from trajopt.gaits.solution import Solution
from trajopt.ocp.arrays import Array
from trajopt.ocp.trajectory import PhaseTrajectory

#: Least share of an interval on either side of a touchdown, so that both sides remain intervals.
LEAST_SHARE = 2e-4

#: Nodes of the quadrature by which a continuous voltage is averaged over an interval.
AVERAGED = 16


@dataclasses.dataclass(frozen=True)
class Stride:
    """A stride, or a guess of one.

    Attributes:
        pattern: in which intervals the touchdowns fall.
        shares: how much of each split interval lies before its touchdown, shape (steps,).
        voltages: of the intervals (V), shape (ticks,); the first is that in which the stride
            begins and ends.
        phases: the states, one phase per step; their controls do not count.
    """

    pattern: Pattern
    shares: Array
    voltages: Array
    phases: tuple[PhaseTrajectory, ...]

    @classmethod
    def of_gait(cls, gait: Solution, hold: float, ticks: int, share: float) -> Stride:
        """A gait stretched to `ticks` intervals, its voltage averaged over each.

        Args:
            gait: any.
            hold: s.
            ticks: intervals per stride.
            share: how much of its interval lies before the first touchdown, in (0, 1).
        """
        stretch = ticks * hold / gait.duration
        touchdowns, lead = gait.phase_times * stretch, (1.0 - share) * hold
        pattern = Pattern.around(hold, touchdowns, lead)
        shares = ((touchdowns[1:] - lead) / hold) % 1.0
        s, weights = np.polynomial.legendre.leggauss(AVERAGED)
        times = lead + hold * (np.arange(ticks)[:, None] - 1.0 + 0.5 * (s + 1.0))
        sampled = gait.control(times.ravel() / stretch).reshape(times.shape)
        phases = tuple(
            dataclasses.replace(phase, edges=phase.edges * stretch) for phase in gait.phases
        )
        return cls(pattern, bounded(shares), 0.5 * sampled @ weights, phases)

    @property
    def step_ticks(self) -> tuple[int, ...]:
        """How many intervals each step lasts, rounded."""
        lengths = np.array(self.pattern.whole) + 1.0 + self.shares - np.roll(self.shares, 1)
        return tuple(np.rint(lengths).astype(int).tolist())

    def neighbours(self) -> Iterator[Stride]:
        """Guesses with one touchdown an interval later or earlier; none where there is one step.

        (Where all touchdowns move alike, nothing changes.)
        """
        for step, side in itertools.product(range(self.pattern.steps - 1), (-1, 1)):
            pattern = self.pattern.moved(step, side)
            if pattern is not None:
                yield dataclasses.replace(self, pattern=pattern)


def bounded(shares: Array) -> Array:
    """Shares within their bounds."""
    return np.clip(shares, LEAST_SHARE, 1.0 - LEAST_SHARE)
