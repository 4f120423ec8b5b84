"""What a comparison compares, and what its methods share: a folder, and the optimal fronts."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from pathlib import Path
from typing import Any

from agents.evaluate import EPISODE, PROTOCOL, Protocol, evaluate
from agents.gaps import FRONT_STEPS, gap_to_front, reward_rate
from agents.rollout import Policy
from rimless_gym.checks import integer, positive
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import preset
from trajopt import NoGaitError, Solution
from trajopt.gaits.fronts import CotFront
from trajopt.gaits.held_stride import held_speed, held_speeds
from trajopt.ocp.ranking import tied
from trajopt.store import Store

#: The fields that are counts.
_COUNTS = ("seed", "starts", "timesteps", "scratch_timesteps", "evolution_timesteps")


@dataclasses.dataclass(frozen=True)
class Study:
    """What is compared.

    Attributes:
        preset: name of the machine.
        changes: fields of the machine that differ from the preset's.
        speed: of the gait that all laws hold and learners imitate (m/s). As all speeds here, it
            stands for the nearest one at which a step lasts a whole number of control intervals.
        further: speeds at which the optimum and the policy for the front are shown too (m/s).
        steps: of the gait that is searched for and reported beside the front's best.
        seed: of everything random.
        timesteps: control intervals of fine-tuning.
        scratch_timesteps: control intervals of PPO from scratch.
        evolution_timesteps: control intervals of evolution.
        starts: random starts of the search for the gait, in addition to the shipped guess.
        front: least and greatest speed of the optimal front (m/s), enclosing the learned ones. A
            clone may walk a little slower than the gait that it imitates.
        front_steps: steps per stride of the gaits of the front.
        retrain: whether policies are trained also where those that come with the package are what
            the study's machine, speed, seed and control intervals give.

    Raises:
        TypeError: a value is of the wrong kind.
        ValueError: there is no such preset or field, or a number is out of its range.
    """

    preset: str = "BUILDABLE"
    changes: dict[str, Any] = dataclasses.field(default_factory=dict)
    speed: float = 0.62
    further: tuple[float, ...] = (0.56, 0.60)
    steps: int = 1
    seed: int = 0
    timesteps: int = 100_000_000
    scratch_timesteps: int = 250_000
    evolution_timesteps: int = 600_000_000
    starts: int = 4
    front: tuple[float, ...] = (0.55, 0.64)
    front_steps: tuple[int, ...] = FRONT_STEPS
    retrain: bool = False

    def __post_init__(self) -> None:
        for name in ("further", "front", "front_steps"):  # lists, if they come from JSON
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for speed in (self.speed, *self.further, *self.front):
            positive("speed", speed)
        for steps in (self.steps, *self.front_steps):
            integer("steps", steps, 1)
        for name in _COUNTS:
            integer(name, getattr(self, name), 0)
        if len(self.front) != 2 or self.front[0] > self.front[1] or not self.front_steps:
            raise ValueError(
                f"front = {self.front}, front_steps = {self.front_steps}: must be the least "
                "and the greatest speed (m/s), and one or more numbers of steps"
            )
        _ = self.front_speeds  # refused here if it is out of range
        if len({self.on_tick(speed) for speed in self.speeds}) < len(self.speeds):
            raise ValueError(
                f"further = {self.further}: two of these and speed = {self.speed} stand for the "
                "same gait; leave one out"
            )

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return preset(self.preset).replace(**self.changes)

    @property
    def shipped(self) -> bool:
        """Whether the policies that come with the package take the place of their trainings."""
        usual = Study()
        alike = ("params", "speed", "seed", "timesteps", "evolution_timesteps")
        return not self.retrain and all(getattr(self, n) == getattr(usual, n) for n in alike)

    @property
    def speeds(self) -> tuple[float, ...]:
        """All at which optima are shown, as they were given (m/s)."""
        return self.speed, *self.further

    def on_tick(self, speed: float) -> float:
        """The speed nearest to this one at which a step lasts whole control intervals (m/s)."""
        return held_speed(self.params, speed, 1, CONTROL_PERIOD)

    @property
    def front_speeds(self) -> list[float]:
        """Speeds of the gaits of the front (m/s): all between the least and the greatest."""
        enclosed = *self.front, *self.speeds
        return held_speeds(self.params, min(enclosed), max(enclosed), CONTROL_PERIOD)


class Setting:
    """What the methods of a comparison share: what to compare, its folder, and progress bars."""

    def __init__(self, study: Study, out: Path, progress: bool = False) -> None:
        self.study, self.out, self.progress = study, out, progress

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return self.study.params

    @cached_property
    def front(self) -> CotFront:
        """The front of optimal gaits with a continuous voltage, once it is solved."""
        return self._front_of("front")

    @cached_property
    def held_front(self) -> CotFront:
        """The front of gaits that the environment allows: gaps at a walk's own speed are to it."""
        return self._front_of("held_front")

    def _front_of(self, method: str) -> CotFront:
        names = Store(self.out).load(method)["files"]
        return CotFront(tuple(Solution.load(self.out / name) for name in names))

    @cached_property
    def least(self) -> Solution:
        """The environment's best gait at any speed, once it is solved."""
        (name,) = Store(self.out).load("least")["files"]
        return Solution.load(self.out / name)

    def held_gait(self, speed: float) -> Solution:
        """The environment's best gait nearest to a speed (m/s)."""
        return min(self.held_front.envelope, key=lambda gait: abs(gait.speed - speed))

    def best_gait(self, speed: float) -> Solution:
        """The best gait nearest to a speed (m/s), of the fewest steps, with a continuous voltage.

        Raises:
            NoGaitError: there is none at the control interval's speed nearest to it.
        """
        wanted = self.study.on_tick(speed)
        gaits = [gait for gait in self.front.solutions if abs(gait.speed - wanted) < 1e-6]
        if not gaits:
            raise NoGaitError(
                f"speed = {wanted:.4f} m/s: no verified gait; {self.out}/front.json has the "
                "reason; choose a speed between those of the front"
            )
        lowest = min(gait.cot for gait in gaits)
        as_good = [gait for gait in gaits if tied(gait.cot, lowest, 1e-4)]
        return min(as_good, key=lambda gait: gait.steps)

    def evaluated(self, policy: Policy, by: Protocol = PROTOCOL) -> dict[str, Any]:
        """The evaluation of a policy, as plain JSON values."""
        return evaluate(policy, self.params, by, progress=self.progress).to_dict()

    @cached_property
    def best_return(self) -> float:
        """What an episode returns that is on the environment's best gait from its beginning (m)."""
        return EPISODE * max(reward_rate(gait) for gait in (*self.held_front.envelope, self.least))

    def over_least(self, cot: float | None) -> float | None:
        """Gap of a gait or a walk to the environment's optimum at any speed."""
        return None if cot is None else cot / self.least.cot - 1.0

    def gap(self, cot: float | None, speed: float | None) -> float | None:
        """Gap of a gait or a walk to the environment's optimum at its speed; None off its front."""
        return gap_to_front(cot, speed, self.held_front)
