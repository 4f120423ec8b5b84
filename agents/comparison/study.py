"""What a comparison compares."""

from __future__ import annotations

import dataclasses
from typing import Any

from rimless_gym.checks import integer, positive, require_kind
from rimless_gym.params import WheelParams
from rimless_gym.presets import preset


@dataclasses.dataclass(frozen=True)
class Study:
    """What is compared.

    Attributes:
        preset: name of the machine.
        changes: fields of the machine that differ from the preset's.
        speed: at which the gait to imitate is optimal (m/s).
        steps: of the gait that is solved for and reported beside the front's best.
        seed: of everything random.
        timesteps: control intervals of fine-tuning.
        scratch_timesteps: time steps of PPO from scratch, of 4 control intervals each.
        evolution_timesteps: control intervals of evolution.
        starts: random starts of the search for the gait, in addition to the shipped guess.
        front: speeds at which the optimal front is solved (m/s), enclosing the learned ones.

    Raises:
        TypeError: a value is of the wrong kind.
        ValueError: there is no such preset or field, or a number is out of its range.
    """

    preset: str = "BUILDABLE"
    changes: dict[str, Any] = dataclasses.field(default_factory=dict)
    speed: float = 0.56
    steps: int = 1
    seed: int = 0
    timesteps: int = 600_000
    scratch_timesteps: int = 250_000
    evolution_timesteps: int = 600_000_000
    starts: int = 4
    front: tuple[float, ...] = (0.54, 0.56, 0.58, 0.60, 0.62, 0.63)

    def __post_init__(self) -> None:
        require_kind("preset", self.preset, str)
        require_kind("changes", self.changes, dict)
        preset(self.preset).replace(**self.changes)
        positive("speed", self.speed)
        if not isinstance(self.front, (tuple, list)) or not self.front:
            raise TypeError(f"front = {self.front!r}: must be a tuple of one or more speeds (m/s)")
        object.__setattr__(self, "front", tuple(self.front))
        for speed in self.front:
            positive("front: speed", speed)
        for name, least in (
            ("steps", 1),
            ("timesteps", 0),
            ("scratch_timesteps", 0),
            ("evolution_timesteps", 0),
            ("starts", 0),
            ("seed", 0),
        ):
            integer(name, getattr(self, name), least)

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return preset(self.preset).replace(**self.changes)
