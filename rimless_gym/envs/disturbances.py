"""Disturbances for training robust policies: pushes, sensor noise, delay, and varied machines.

Each is drawn from the row's own random stream (`rimless_gym.envs.randomness`). A disturbance that
is not used costs no time.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from rimless_gym.checks import integer, not_negative, real
from rimless_gym.envs.perturbation import Settings
from rimless_gym.envs.plain import made_of
from rimless_gym.kernel.stepping import require_steppable
from rimless_gym.params import CHOICES, WheelParams

MAX_DELAY = 100  # control intervals

#: Largest standard deviation of a sensor's error (rad or rad/s). The sines of the resulting angles
#: are still accurate; after millions of turns they would not be.
MOST_NOISE = 1e3

#: Parameters that may be drawn: those that are numbers, except the number of legs.
DRAWABLE = tuple(
    field.name
    for field in dataclasses.fields(WheelParams)
    if field.name not in ("n_legs", *CHOICES)
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pushes:
    """Blows on the hub along the ground, forward or backward, at random times.

    They come at the start of a control interval. The stance foot does not slip during a blow; it
    never does in this model. In double stance the wheel tips over the foot it is pushed towards.

    Args:
        rate: pushes per second, on average.
        impulse: least and greatest size (N s), drawn uniformly.
    """

    rate: float
    impulse: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "rate", not_negative("rate", self.rate))
        object.__setattr__(self, "impulse", _interval("impulse", self.impulse))
        not_negative("impulse", self.impulse[0])


@dataclasses.dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """Normally distributed errors of the observation; the state itself is not changed.

    No standard deviation may exceed `MOST_NOISE`, far beyond any useful sensor.

    Args:
        leg_angle: standard deviation for the leg's angle (rad).
        pendulum_angle: for the pendulum's angle (rad).
        leg_rate: for the leg's rate (rad/s).
        pendulum_rate: for the pendulum's rate (rad/s).
    """

    leg_angle: float = 0.0
    pendulum_angle: float = 0.0
    leg_rate: float = 0.0
    pendulum_rate: float = 0.0

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            object.__setattr__(self, name, not_negative(name, value))
            if value > MOST_NOISE:
                raise ValueError(
                    f"{name} = {value}: must be at most {MOST_NOISE:g} (rad or rad/s); a noisier "
                    "sensor carries no information"
                )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Disturbances:
    """What disturbs every episode.

    Args:
        pushes: a `Pushes` or a dictionary of its fields; None for none.
        sensor_noise: a `SensorNoise` or a dictionary of its fields; None for none.
        actuator_delay: control intervals from an action to its voltage: a whole number, or
            the least and greatest, between which each episode draws one. Until the first action
            takes effect, the voltage is 0.

    Raises:
        TypeError: a value has the wrong type.
        ValueError: a value is out of its range.
    """

    pushes: Pushes | None = None
    sensor_noise: SensorNoise | None = None
    actuator_delay: int | tuple[int, int] = 0

    def __post_init__(self) -> None:
        for name, kind in (("pushes", Pushes), ("sensor_noise", SensorNoise)):
            value = getattr(self, name)
            if isinstance(value, Mapping):
                object.__setattr__(self, name, made_of(kind, name, value))
            elif value is not None and not isinstance(value, kind):
                raise TypeError(
                    f"{name} = {value!r}: give a rimless_gym.{kind.__name__}, a dictionary of its "
                    "fields, or None"
                )
        object.__setattr__(self, "actuator_delay", _delay(self.actuator_delay))

    @property
    def delays(self) -> tuple[int, int]:
        """Least and greatest delay (intervals)."""
        delay = self.actuator_delay
        return delay if isinstance(delay, tuple) else (delay, delay)

    def settings(self, period: float) -> Settings:
        """The numbers that compiled code takes, for intervals of `period` (s)."""
        pushes = self.pushes or Pushes(rate=0.0, impulse=(0.0, 0.0))
        noise = dataclasses.astuple(self.sensor_noise or SensorNoise())
        return Settings(-math.expm1(-pushes.rate * period), *pushes.impulse, *self.delays, noise)


@dataclasses.dataclass(frozen=True)
class Ranges:
    """Domain randomisation: parameters drawn uniformly from ranges for each episode.

    Args:
        bounds: field of `WheelParams` -> (least, greatest).

    Raises:
        TypeError: a bound is not a number.
        ValueError: a field cannot be drawn, or the bounds are not finite and in order.
    """

    bounds: Mapping[str, tuple[float, float]]

    def __post_init__(self) -> None:
        for name in self.bounds:
            if name not in DRAWABLE:
                raise ValueError(f"{name!r} cannot be drawn: choose from {', '.join(DRAWABLE)}")
        ordered = {n: _interval(n, self.bounds[n]) for n in DRAWABLE if n in self.bounds}
        object.__setattr__(self, "bounds", ordered)

    def require_valid(self, params: WheelParams) -> None:
        """Refuse ranges from which a machine may be drawn that is not valid.

        Tried are all fields at their low ends and all at their high ends, and each of these with
        one field at its other end.

        Raises:
            ValueError: see `WheelParams` and `require_steppable`.
        """
        for end in (0, 1):
            corner = {name: bounds[end] for name, bounds in self.bounds.items()}
            require_steppable(params.replace(**corner))
            for name, bounds in self.bounds.items():
                require_steppable(params.replace(**corner | {name: bounds[1 - end]}))


def as_ranges(ranges: Ranges | Mapping[str, Any] | None) -> Ranges:
    """Ranges from a mapping of bounds, or from {"bounds": such a mapping}; None means no ranges.

    Raises:
        TypeError: it is neither.
        ValueError: see `Ranges`.
    """
    if isinstance(ranges, Ranges):
        return ranges
    if not isinstance(ranges, Mapping | None):
        raise TypeError(f"ranges = {ranges!r}: give a mapping of fields to (least, greatest)")
    if ranges and list(ranges) == ["bounds"]:
        return as_ranges(ranges["bounds"])
    return Ranges(ranges or {})


def as_disturbances(disturbances: Disturbances | Mapping[str, Any] | None) -> Disturbances:
    """Disturbances, given as such or as a mapping of their fields; None means none.

    Raises:
        TypeError: it is neither.
        ValueError: a field is unknown or its value out of range.
    """
    if isinstance(disturbances, Mapping):
        return made_of(Disturbances, "disturbances", disturbances)
    if not isinstance(disturbances, Disturbances | None):
        raise TypeError(
            f"disturbances = {disturbances!r}: give a rimless_gym.Disturbances or a dictionary of "
            "its fields"
        )
    return disturbances or Disturbances()


def _delay(delay: Any) -> int | tuple[int, int]:
    """The delay (intervals), or the least and the greatest, as plain integers."""
    if not isinstance(delay, Sequence):
        return integer("actuator_delay", delay, 0, MAX_DELAY)
    each = [integer("actuator_delay", one, 0, MAX_DELAY) for one in delay]
    if len(each) != 2:
        raise ValueError(f"actuator_delay = {delay}: give one number, or two")
    if each[0] > each[1]:
        raise ValueError(f"actuator_delay = {delay}: must be in order, the least first")
    return each[0], each[1]


def _interval(name: str, bounds: Any) -> tuple[float, float]:
    try:
        low, high = bounds
    except (TypeError, ValueError):
        raise TypeError(f"{name} = {bounds!r}: give the least and the greatest value") from None
    low, high = real(f"the least {name}", low), real(f"the greatest {name}", high)
    if low > high:
        raise ValueError(f"{name} = {bounds}: must be in order, the least first")
    return low, high
