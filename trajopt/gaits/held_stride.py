"""A stride under a held voltage: its clock, its touchdowns between the ticks, its states."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator

import numpy as np

from rimless_gym.checks import positive
from rimless_gym.params import WheelParams
from trajopt.gaits.solution import Solution
from trajopt.ocp.arrays import Array, Indices
from trajopt.ocp.trajectory import PhaseTrajectory

#: Shortest period (s). At 1 ms a held gait costs what the continuous one does, to about 1e-4.
SHORTEST_HOLD = 1e-3

#: Most periods in a stride; a stride of so many takes about a minute to solve.
MOST_TICKS = 3000

#: Least share of an interval on either side of a touchdown, so that both sides remain intervals.
LEAST_SHARE = 2e-4

#: Nodes of the quadrature by which a continuous voltage is averaged over an interval.
AVERAGED = 16


def ticks_of_stride(params: WheelParams, speed: float, steps: int, hold: float) -> int:
    """How many periods a stride lasts if its speed is to be as near to `speed` as possible.

    Args:
        params: the machine.
        speed: m/s, > 0.
        steps: touchdowns per stride, >= 1.
        hold: period (s), at least `SHORTEST_HOLD`; a stride has at least two of them per step, and
            at most `MOST_TICKS` in all.

    Raises:
        TypeError: `hold` is not a real number.
        ValueError: `hold` is out of its range.
    """
    hold = positive("hold", hold)
    if hold < SHORTEST_HOLD:
        raise ValueError(
            f"hold = {hold}: must be at least {SHORTEST_HOLD} s; leave it out for the gait with a "
            "continuous voltage, from which a finer one hardly differs"
        )
    distance = steps * params.step_length
    wanted = distance / speed / hold
    fewest = 2 * steps - 0.5  # is rounded up
    if wanted < fewest:
        longest, fastest = distance / speed / fewest, distance / (fewest * hold)
        raise ValueError(
            f"hold = {hold}: must be at most {longest:.3g} s at {speed:g} m/s, so that a step has "
            f"two control intervals; or ask for at most {fastest:.3g} m/s"
        )
    if wanted > MOST_TICKS:
        raise ValueError(
            f"hold = {hold}: must be at least {distance / speed / MOST_TICKS:.3g} s at {speed:g} "
            f"m/s with steps = {steps}, so that a stride has at most {MOST_TICKS} control "
            "intervals; or ask for fewer steps or a higher speed"
        )
    counts = [max(math.floor(wanted), 2 * steps), math.ceil(wanted)]
    return min(counts, key=lambda n: abs(distance / (n * hold) - speed))


def held_speeds(params: WheelParams, slowest: float, fastest: float, hold: float) -> list[float]:
    """All speeds (m/s) at which a step lasts whole periods, between those nearest to these two.

    Takes and refuses what `ticks_of_stride` does.
    """
    counts = [ticks_of_stride(params, speed, 1, hold) for speed in (fastest, slowest)]
    return [params.step_length / (n * hold) for n in range(counts[1], counts[0] - 1, -1)]


def held_speed(params: WheelParams, speed: float, steps: int, hold: float) -> float:
    """The speed (m/s) of the strides that can be repeated under the clock, nearest to `speed`.

    Takes and refuses what `ticks_of_stride` does.
    """
    ticks = ticks_of_stride(params, speed, steps, hold)
    return steps * params.step_length / (ticks * hold)


@dataclasses.dataclass(frozen=True)
class Pattern:
    """The control intervals of a stride that begins and ends with a touchdown.

    Every touchdown splits an interval. The one at the stride's end splits the same interval as the
    one at its start, so that the stride lasts a whole number of intervals.
    """

    hold: float  # length of an interval (s)
    # for every step, how many intervals lie between its two touchdowns, >= 0
    whole: tuple[int, ...]

    @classmethod
    def around(cls, hold: float, touchdowns: Array, first_tick: float) -> Pattern:
        """The pattern of a stride with given touchdowns.

        Args:
            hold: s.
            touchdowns: times (s), the first 0 and the last a multiple of `hold`, (steps + 1,).
            first_tick: time (s) of the first tick after the first touchdown, in (0, hold).
        """
        passed = np.ceil((touchdowns - first_tick) / hold).astype(
            int
        )  # ticks before each touchdown
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


@dataclasses.dataclass(frozen=True)
class HeldStride:
    """A stride, or a guess of one."""

    pattern: Pattern  # in which intervals the touchdowns fall
    shares: Array  # how much of each split interval lies before its touchdown, shape (steps,)
    # of the intervals (V), shape (ticks,); the first is that in which the stride begins and ends
    voltages: Array
    # the states, one phase per step; their controls do not count
    phases: tuple[PhaseTrajectory, ...]

    @classmethod
    def from_gait(cls, gait: Solution, hold: float, ticks: int, share: float) -> HeldStride:
        """A gait stretched to `ticks` intervals, its voltage averaged over each.

        Args:
            gait: any.
            hold: s.
            ticks: intervals per stride.
            share: how much of its interval lies before the first touchdown, in (0, 1).
        """
        stretch = ticks * hold / gait.duration
        touchdowns, first = gait.phase_times * stretch, (1.0 - share) * hold
        pattern = Pattern.around(hold, touchdowns, first)
        shares = ((touchdowns[1:] - first) / hold) % 1.0
        s, weights = np.polynomial.legendre.leggauss(AVERAGED)
        times = first + hold * (np.arange(ticks)[:, None] - 1.0 + 0.5 * (s + 1.0))
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

    def neighbours(self) -> Iterator[HeldStride]:
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
