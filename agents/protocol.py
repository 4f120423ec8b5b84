"""From where, for how long and over which part of its walks a policy is judged."""

from __future__ import annotations

import dataclasses

from rimless_gym.checks import integer, real
from rimless_gym.hybrid import CONTROL_PERIOD


@dataclasses.dataclass(frozen=True)
class Protocol:
    """From where, for how long, and over which part a policy is judged.

    Attributes:
        starts: number of starts.
        seed: of the starts; never that of a training.
        duration: of a walk (s).
        window: at its end, over which everything is measured (s).
        alive: at its end, in which a walk must still take net forward steps (s).

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: a time is shorter than a control period, they are not in the order
            alive <= window <= duration, starts < 1, or seed < 0.
    """

    starts: int = 128
    seed: int = 20150501
    duration: float = 50.0
    window: float = 30.0
    alive: float = 10.0

    def __post_init__(self) -> None:
        integer("starts", self.starts, 1)
        integer("seed", self.seed, 0)
        for name in ("duration", "window", "alive"):
            seconds = real(name, getattr(self, name))
            if 0.0 < seconds < CONTROL_PERIOD:
                raise ValueError(
                    f"{name} = {seconds} s: must be at least {CONTROL_PERIOD} s, a control period"
                )
        if not 0 < self.alive <= self.window <= self.duration:
            raise ValueError(
                f"alive = {self.alive} s, window = {self.window} s, duration = {self.duration} s: "
                "must be positive and grow in this order"
            )


#: The protocol of every published figure.
PROTOCOL = Protocol()

#: With fewer starts and shorter walks, for policies that are changed or disturbed in many ways.
SHORT_PROTOCOL = Protocol(starts=48, seed=20150502, duration=20.0, window=10.0, alive=5.0)

#: For keeping the best of many checkpoints during training. The walks are as long as the published
#: ones: a gait can last 20 s from every start, and 50 s from none.
TRAINING_PROTOCOL = Protocol(starts=48, seed=20150502, duration=50.0, window=10.0, alive=5.0)
