"""What a comparison compares."""

from __future__ import annotations

import dataclasses
import math

from rimless_gym.params import WheelParams, preset


@dataclasses.dataclass(frozen=True)
class Study:
    """What is compared.

    Attributes:
        preset: name of the machine.
        speed: at which the gait to imitate is optimal (m/s).
        steps: of the gait that is solved for and reported beside the front's best.
        seed: of everything random.
        timesteps: control intervals of fine-tuning, and of training from scratch.
        starts: random starts of the search for the gait, beside the shipped guess.
        front: speeds at which the optimal front is solved (m/s), enclosing the learned ones.
    """

    preset: str = "THESIS_PHYSICAL"
    speed: float = 0.5
    steps: int = 2
    seed: int = 0
    timesteps: int = 600_000
    starts: int = 4
    front: tuple[float, ...] = (0.40, 0.45, 0.50, 0.525, 0.55, 0.57, 0.58, 0.59, 0.60)

    def __post_init__(self) -> None:
        for speed in (self.speed, *self.front):
            if not (math.isfinite(speed) and speed > 0):
                raise ValueError(f"speed = {speed}: must be finite and greater than 0 m/s")
        for name, least in (("steps", 1), ("timesteps", 0), ("starts", 0), ("seed", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} = {getattr(self, name)}: must be at least {least}")

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return preset(self.preset)
