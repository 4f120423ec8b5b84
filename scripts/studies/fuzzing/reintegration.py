"""A control interval of the compiled environment, compared with the reference simulator."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rimless_gym import WheelParams, simulate
from rimless_gym.equations import DOUBLE, MODE_NAMES
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import FOOT, MODE

Floats = NDArray[np.float64]

#: Largest difference that passes: of angles (rad), of rates and energies relative to their size.
DIFFERENCE = 1e-8

#: Relative distance between starts within which rounding may decide whether a foot touches down or
#: lifts off, so that two motions have different events.
NEARBY = 1e-8
ALIKE = 1e-5  # largest difference between motions from such starts that have the same events


@dataclasses.dataclass(frozen=True)
class Interval:
    """One control interval of one row.

    Attributes:
        params: the machine.
        before: hybrid state at its start.
        voltage: V.
        after: hybrid state at its end; None where the episode ended.
        elapsed: s.
        electrical: integral of V i (J).
        distance: of the hub (m).
    """

    params: WheelParams
    before: Floats
    voltage: float
    after: Floats | None
    elapsed: float
    electrical: float
    distance: float


def difference(interval: Interval) -> tuple[float, bool]:
    """How far the reference simulator's motion is from the interval's, and if it is borderline.

    An interval is borderline if the reference agrees with it only from a start within `NEARBY`.

    Returns:
        The difference, infinite if the two have different events, NaN if the reference simulator
        fails because the motion diverges or chatters; and whether the interval is borderline.
    """
    try:
        found = _from(interval, interval.before[:4], interval.voltage)
        if found <= DIFFERENCE:
            return found, False
        for start, voltage in _nearby(interval):
            if _from(interval, start, voltage) <= ALIKE:
                return found, True
    except ValueError:  # the state before the interval is not possible
        return math.inf, False
    except RuntimeError:
        return math.nan, False
    return found, False


def _from(interval: Interval, start: Floats, voltage: float) -> float:
    """The difference from the reference's motion; infinite if the two have different events."""
    params, mode = interval.params, MODE_NAMES[int(interval.before[MODE])]
    motion = simulate(params, start, [voltage], CONTROL_PERIOD, mode=mode, pull=0.0)
    ledger = motion.ledger
    elapsed = abs(ledger.time - interval.elapsed) / CONTROL_PERIOD
    power = abs(ledger.electrical) + ledger.losses.copper + params.weight * params.leg_length
    other = [
        elapsed,
        abs(ledger.electrical - interval.electrical) / power,
        abs(ledger.distance - interval.distance) / params.leg_length,
    ]
    if interval.after is None:
        return max(other) if motion.failure is not None else math.inf
    if motion.failure is not None or motion.final_mode != MODE_NAMES[int(interval.after[MODE])]:
        return math.inf
    if motion.steps != interval.after[FOOT] - interval.before[FOOT]:
        return math.inf
    scale = np.maximum(1.0, np.abs([1.0, 1.0, *interval.after[2:4]]))
    apart = np.abs(motion.x[-1] - interval.after[:4])
    apart[1] /= max(1.0, abs(interval.before[1]))  # a large theta has large rounding errors
    return max(float((apart / scale).max()), *other)


def _nearby(interval: Interval) -> Iterator[tuple[Floats, float]]:
    """Starts and voltages within `NEARBY` of the interval's."""
    p, standing = interval.params.constants, interval.before[MODE] == DOUBLE
    for i in (1, 3) if standing else range(4):
        for sign in (-1, 1):
            start = interval.before[:4].copy()
            start[i] += sign * NEARBY * max(1.0, abs(start[i]))
            start[0] = min(max(start[0], p.a), p.b)
            yield start, interval.voltage
    for sign in (-1, 1):
        nearly = interval.voltage + sign * NEARBY * interval.params.voltage_limit
        yield interval.before[:4], nearly
