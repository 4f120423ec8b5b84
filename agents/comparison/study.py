"""What a comparison compares."""

from __future__ import annotations

import dataclasses
from typing import Any

from agents.gaps import FRONT_STEPS
from rimless_gym.checks import integer, positive, require_kind
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import preset
from trajopt.gaits.held_stride import held_speed, held_speeds
from trajopt.gaits.problem import lacks_power


@dataclasses.dataclass(frozen=True)
class Study:
    """What is compared.

    Attributes:
        preset: name of the machine.
        changes: fields of the machine that differ from the preset's.
        speed: of the gaits that all laws hold and learners imitate (m/s). As all speeds here, it
            stands for the nearest one at which a step lasts a whole number of control intervals.
        further: speeds at which the best law and its clone walk too (m/s).
        steps: of the gait that is searched for and reported beside the front's best.
        seed: of everything random.
        timesteps: control intervals of fine-tuning.
        further_timesteps: control intervals of fine-tuning at each of the further speeds; 0: the
            clones stay as they are.
        scratch_timesteps: time steps of PPO from scratch, of 4 control intervals each.
        evolution_timesteps: control intervals of evolution.
        starts: random starts of the search for the gait, in addition to the shipped guess.
        front: least and greatest speed of the optimal front (m/s), enclosing the learned ones. A
            clone may walk a little slower than the gait that it imitates.
        front_steps: steps per stride of the gaits of the front.

    Raises:
        TypeError: a value is of the wrong kind.
        ValueError: there is no such preset or field, a number is out of its range, or the motor is
            too weak for a speed.
    """

    preset: str = "BUILDABLE"
    changes: dict[str, Any] = dataclasses.field(default_factory=dict)
    speed: float = 0.56
    further: tuple[float, ...] = (0.53, 0.60)
    steps: int = 1
    seed: int = 0
    timesteps: int = 600_000
    further_timesteps: int = 0
    scratch_timesteps: int = 250_000
    evolution_timesteps: int = 600_000_000
    starts: int = 4
    front: tuple[float, ...] = (0.52, 0.63)
    front_steps: tuple[int, ...] = FRONT_STEPS

    def __post_init__(self) -> None:
        require_kind("preset", self.preset, str)
        require_kind("changes", self.changes, dict)
        preset(self.preset).replace(**self.changes)
        positive("speed", self.speed)
        for name in ("further", "front"):
            speeds = getattr(self, name)
            if not isinstance(speeds, (tuple, list)):
                raise TypeError(f"{name} = {speeds!r}: must be a tuple of speeds (m/s)")
            object.__setattr__(self, name, tuple(positive(f"{name}: speed", v) for v in speeds))
        if len(self.front) != 2 or self.front[0] > self.front[1]:
            raise ValueError(
                f"front = {self.front}: must be two speeds (m/s), the least and the greatest"
            )
        if not isinstance(self.front_steps, (tuple, list)) or not self.front_steps:
            raise TypeError(f"front_steps = {self.front_steps!r}: must be a tuple such as (1, 2)")
        steps = tuple(integer("front_steps: number", n, 1) for n in self.front_steps)
        object.__setattr__(self, "front_steps", steps)
        _ = self.front_speeds  # what is out of range is refused before a folder is claimed
        if len({self.on_tick(speed) for speed in self.speeds}) < len(self.speeds):
            raise ValueError(
                f"further = {self.further}: two of these and speed = {self.speed} stand for the "
                "same gait; leave one out"
            )
        for name, least in (
            ("steps", 1),
            ("timesteps", 0),
            ("further_timesteps", 0),
            ("scratch_timesteps", 0),
            ("evolution_timesteps", 0),
            ("starts", 0),
            ("seed", 0),
        ):
            integer(name, getattr(self, name), least)
        for speed in self.speeds:
            if why := lacks_power(self.params, speed, self.steps):
                raise ValueError(why)

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return preset(self.preset).replace(**self.changes)

    @property
    def speeds(self) -> tuple[float, ...]:
        """All at which laws and clones walk, as they were given (m/s)."""
        return self.speed, *self.further

    def on_tick(self, speed: float) -> float:
        """The speed nearest to this one at which a step lasts whole control intervals (m/s)."""
        return held_speed(self.params, speed, 1, CONTROL_PERIOD)

    @property
    def front_speeds(self) -> list[float]:
        """Speeds of the gaits of the front (m/s): all between the least and the greatest."""
        enclosed = *self.front, *self.speeds
        return held_speeds(self.params, min(enclosed), max(enclosed), CONTROL_PERIOD)
