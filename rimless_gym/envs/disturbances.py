"""Disturbances of a walk: pushes, rough ground, sensor noise, delay, and varied machines.

Each is drawn from the row's own random stream. A disturbance that is not used costs no time.

An episode takes a single 64-bit key from its row's NumPy generator. Everything random in it
(machine, start, ground, pushes, sensor noise, delay) comes from the stream that begins at that key;
see `rimless_gym.streams`. So a row draws the same numbers whether it is stepped alone or not.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from rimless_gym.checks import KindError, as_instance, integer, not_negative, real
from rimless_gym.envs.layout import MEMORY, observe_row, params_at
from rimless_gym.equations import DOUBLE, SINGLE, record
from rimless_gym.hybrid import kinetic_energy, push
from rimless_gym.jit import cached, inner
from rimless_gym.kernel.stepping import require_steppable
from rimless_gym.params import CHOICES, WheelParams
from rimless_gym.streams import between, next_uniform, normal

MAX_DELAY = 100  # control intervals

#: Largest standard deviation of a sensor's error (rad or rad/s). The sines of the resulting angles
#: are still accurate; after millions of turns they would not be.
MOST_NOISE = 1e3

#: Largest standard deviation of the ground's slope (rad): 11 degrees.
MOST_ROUGHNESS = 0.2

#: Parameters that may be drawn: those that are numbers, except the number of legs.
DRAWABLE = tuple(
    field.name
    for field in dataclasses.fields(WheelParams)
    if field.name not in ("n_legs", *CHOICES)
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Pushes:
    """Impulses on the hub along the ground, forward or backward, at random times.

    They come at the beginning of a control interval. The stance foot does not slip during a push,
    as never in this model. In double stance the wheel tips over the foot it is pushed towards.

    Args:
        rate: pushes per second, on average.
        impulse: least and greatest size (N s), drawn uniformly.
    """

    rate: float
    impulse: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "rate", not_negative("rate", self.rate))
        object.__setattr__(self, "impulse", _ordered("impulse", self.impulse))
        not_negative("impulse", self.impulse[0])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Terrain:
    """Rough ground: at every touchdown, the way to the next foothold has a new slope.

    Slopes are normally distributed about the machine's slope, as in Byl and Tedrake, "Metastable
    walking machines" (IJRR 2009), and clipped at `rimless_gym.streams.MOST_TURN` leg angles to both
    sides. All angles, forces and clearances stay those of the machine's slope: only the footholds'
    places vary. The observation does not show what lies ahead.

    Args:
        slope_std: standard deviation of the slope (rad), at most `MOST_ROUGHNESS`.
    """

    slope_std: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "slope_std", not_negative("slope_std", self.slope_std))
        if self.slope_std > MOST_ROUGHNESS:
            raise ValueError(
                f"slope_std = {self.slope_std}: must be at most {MOST_ROUGHNESS:g} rad; give "
                "radians, not degrees"
            )


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
        terrain: a `Terrain` or a dictionary of its fields; None for even ground.

    Raises:
        TypeError: a value has the wrong type.
        ValueError: a value is out of its range.
    """

    pushes: Pushes | None = None
    sensor_noise: SensorNoise | None = None
    actuator_delay: int | tuple[int, int] = 0
    terrain: Terrain | None = None

    def __post_init__(self) -> None:
        kinds = {"pushes": Pushes, "sensor_noise": SensorNoise, "terrain": Terrain}
        for name, kind in kinds.items():
            object.__setattr__(self, name, as_instance(kind, name, getattr(self, name), None))
        object.__setattr__(self, "actuator_delay", _checked_delay(self.actuator_delay))

    @property
    def delays(self) -> tuple[int, int]:
        """Least and greatest delay (intervals)."""
        delay = self.actuator_delay
        return delay if isinstance(delay, tuple) else (delay, delay)

    def settings(self, period: float) -> Any:
        """The numbers that compiled code takes, for intervals of `period` (s)."""
        pushes = self.pushes or Pushes(rate=0.0, impulse=(0.0, 0.0))
        noise = dataclasses.astuple(self.sensor_noise or SensorNoise())
        chance = -math.expm1(-pushes.rate * period)
        slope_std = self.terrain.slope_std if self.terrain else 0.0
        return Settings(chance, *pushes.impulse, *self.delays, slope_std, noise)


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
        ordered = {n: _ordered(n, self.bounds[n]) for n in DRAWABLE if n in self.bounds}
        object.__setattr__(self, "bounds", ordered)

    def require_valid(self, machines: Iterable[WheelParams]) -> None:
        """Refuse ranges from which a machine may be drawn that is not valid.

        Tried are all fields at their low ends and all at their high ends, and each of these with
        one field at its other end. The machines' other parameters are not drawn.
        """
        for params in dict.fromkeys(machines) if self.bounds else ():
            for end in (0, 1):
                corner: dict[str, Any] = {name: each[end] for name, each in self.bounds.items()}
                require_steppable(dataclasses.replace(params, **corner))
                for name, bounds in self.bounds.items():
                    other = corner | {name: bounds[1 - end]}
                    require_steppable(dataclasses.replace(params, **other))


def as_ranges(ranges: Ranges | Mapping[str, Any] | None) -> Ranges:
    """Ranges from a mapping of bounds, or from {"bounds": such a mapping}; None means no ranges."""
    if isinstance(ranges, Ranges):
        return ranges
    if not isinstance(ranges, Mapping | None):
        raise KindError(f"ranges = {ranges!r}: give a mapping of fields to (least, greatest)")
    if ranges and list(ranges) == ["bounds"]:
        return as_ranges(ranges["bounds"])
    return Ranges(ranges or {})


def as_disturbances(disturbances: Disturbances | Mapping[str, Any] | None) -> Disturbances:
    """Disturbances, given as such or as a mapping of their fields; None means none."""
    return as_instance(Disturbances, "disturbances", disturbances, Disturbances())


def _checked_delay(delay: Any) -> int | tuple[int, int]:
    """The delay (intervals), or the least and the greatest, as plain integers."""
    if not isinstance(delay, Sequence):
        return integer("actuator_delay", delay, 0, MAX_DELAY)
    each = [integer("actuator_delay", one, 0, MAX_DELAY) for one in delay]
    if len(each) != 2:
        raise ValueError(f"actuator_delay = {delay}: give one number, or two")
    if each[0] > each[1]:
        raise ValueError(f"actuator_delay = {delay}: must be in order, the least first")
    return each[0], each[1]


def _ordered(name: str, bounds: Any) -> tuple[float, float]:
    try:
        low, high = bounds
    except (TypeError, ValueError):
        raise KindError(f"{name} = {bounds!r}: give the least and the greatest value") from None
    low, high = real(f"the least {name}", low), real(f"the greatest {name}", high)
    if low > high:
        raise ValueError(f"{name} = {bounds}: must be in order, the least first")
    return low, high


# What compiled code does with them, before and after a control interval

#: The numbers of a `Disturbances`: probability of a push in an interval; least and greatest impulse
#: of a push (N s) and delay from action to voltage (intervals); standard deviation of the ground's
#: slope (rad); and those of the errors of phi, theta (rad), phi' and theta' (rad/s), a tuple.
Settings = record(
    "Settings",
    [
        *("push_chance", "least_impulse", "greatest_impulse"),
        *("least_delay", "greatest_delay", "slope_std", "noise"),
    ],
    __name__,
)


@inner
def errors(noise, streams, i):
    """The next errors of the sensors, from stream i."""
    return (
        noise[0] * normal(streams, i),
        noise[1] * normal(streams, i),
        noise[2] * normal(streams, i),
        noise[3] * normal(streams, i),
    )


@inner
def _delay_action(memory, held, i):
    """Replace the action given now by the one given `delay` intervals ago."""
    length, now = held.shape[0], int(memory[MEMORY.count, i])
    held[now % length, i] = memory[MEMORY.action, i]
    memory[MEMORY.action, i] = held[(now + length - int(memory[MEMORY.delay, i])) % length, i]


@inner
def _push(memory, impulse, p, i):
    """Push row i's hub along the ground; in double stance it tips over one of the feet."""
    phi, shift = memory[MEMORY.phi, i], 0
    theta, dphi, dtheta = memory[MEMORY.theta, i], memory[MEMORY.dphi, i], memory[MEMORY.dtheta, i]
    if memory[MEMORY.mode, i] == DOUBLE and impulse < 0.0:
        phi, shift = p.b + (phi - p.a), -1  # on rough ground, both feet are turned
    before = kinetic_energy(phi, theta, dphi, dtheta, p)
    dphi, dtheta = push(phi, theta, dphi, dtheta, impulse, 0.0, p)
    memory[MEMORY.mode, i], memory[MEMORY.phi, i] = SINGLE, phi
    memory[MEMORY.foot, i] += shift
    memory[MEMORY.dphi, i], memory[MEMORY.dtheta, i] = dphi, dtheta
    memory[MEMORY.push_work, i] = kinetic_energy(phi, theta, dphi, dtheta, p) - before
    memory[MEMORY.push_shift, i] = shift


@cached(nogil=True)
def disturb_rows(memory, constants, streams, held, settings, first, last):
    """Before the interval: delay the actions, and push.

    `held` (longest delay + 1, N) keeps actions until they take effect.
    """
    for i in range(first, last):
        _delay_action(memory, held, i)
        memory[MEMORY.push_work, i] = memory[MEMORY.push_shift, i] = 0.0
        if settings.push_chance > 0.0 and next_uniform(streams, i) < settings.push_chance:
            impulse = between(settings.least_impulse, settings.greatest_impulse, streams, i)
            if next_uniform(streams, i) < 0.5:
                impulse = -impulse
            if impulse != 0.0:
                _push(memory, impulse, params_at(constants, i), i)


@cached(nogil=True)
def observe_noisily(observations, width, memory, streams, noise, first, last):
    """After the interval: observe again with the sensors' errors, still within bounds."""
    for i in range(first, last):
        observe_row(memory, errors(noise, streams, i), observations, np.uint64(width), np.uint64(i))
