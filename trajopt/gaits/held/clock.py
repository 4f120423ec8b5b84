"""The clock of a held gait: a stride lasts a whole number of its periods."""

from __future__ import annotations

import math

from rimless_gym.checks import positive
from rimless_gym.params import WheelParams

#: Shortest period (s). At 1 ms a held gait costs what the continuous one does, to about 1e-4.
SHORTEST_HOLD = 1e-3

#: Most periods in a stride; a stride of so many takes about a minute to solve.
MOST_TICKS = 3000


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
