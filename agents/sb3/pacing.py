"""A self-paced price of distance for any learner of stable-baselines3 in our environments.

    envs = Sb3VecEnv(gym.make_vec("RimlessWheel-v0", num_envs=64, autoreset_mode="SameStep"))
    model = PPO("MlpPolicy", HeldActions(VecMonitor(envs), 4), gamma=0.98)
    model.learn(2_000_000, SelfPacedPrice(first_price=5.0))

Why a price must be paced is said in `agents.pacing` and in docs/learning.md.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from agents.pacing import (
    FEWEST_STEPS,
    LEAST_SHARE,
    MULTIPLE,
    NO_WALK,
    CleanWalking,
    paced_price,
)
from rimless_gym import RimlessWheelSpeedVectorEnv, RimlessWheelVectorEnv
from rimless_gym.checks import integer, not_negative, positive
from rimless_gym.envs.task import Task
from rimless_gym.rules import exceeds

#: The shortest walk by which a policy can be judged (s): some control periods of any length.
SHORTEST = 0.4


@dataclasses.dataclass(frozen=True)
class Pacing:
    """How the price of distance follows the policy.

    Attributes:
        first_price: reward per metre at first; it falls with the policy's own cost of transport.
        least_share: of starts that must walk before the price falls.
        multiple: of the policy's own cost of transport, which the price becomes; greater than 1.
            With a small one, a policy may stay with a slow gait that is dear for its speed.
        margin: the most that the price exceeds the policy's own cost of transport (reward per
            metre); by default there is no limit. A small one makes dear gaits cheaper sooner.
        least_price: below which it never falls; None: the environment's own. Near the optimum a
            lower one lets what a learner earns depend more on energy.
        paid_speed: speed up to which travel is paid in training (m/s), so that running does not
            pay however high the price is.
        fall_penalty: travel forfeited by an early end in training (m), in place of the task's.
            At a high price 2 m make resting safer than walking.
        slip_penalty: travel forfeited per second of slipping in training (m/s), likewise. A high
            one keeps a policy from slipping a little at every touchdown.
        every: time steps, of all environments together, between two looks at the policy.
        starts: from which it then walks.
        seconds: for how long; the second half is judged.

    Raises:
        TypeError: a value is not a number.
        ValueError: a value is out of range.
    """

    first_price: float = 20.0
    least_share: float = LEAST_SHARE
    multiple: float = MULTIPLE
    margin: float = math.inf
    least_price: float | None = None
    paid_speed: float = 0.6
    fall_penalty: float = 0.5
    slip_penalty: float = 1.0
    every: int = 100_000
    starts: int = 64
    seconds: float = 8.0

    def __post_init__(self) -> None:
        for name in ("first_price", "least_share", "fall_penalty", "slip_penalty"):
            not_negative(name, getattr(self, name))
        if self.least_price is not None:
            positive("least_price", self.least_price)
        if self.margin != math.inf:
            positive("margin", self.margin)
        if positive("multiple", self.multiple) <= 1.0:
            raise ValueError(
                f"multiple = {self.multiple:g}: walking must earn more than it costs, so give "
                "more than 1; 2 is usual"
            )
        if self.least_share > 1.0:
            raise ValueError(f"least_share = {self.least_share:g}: must be at most 1, all starts")
        positive("paid_speed", self.paid_speed)
        if positive("seconds", self.seconds) < SHORTEST:
            raise ValueError(f"seconds = {self.seconds:g}: must be at least {SHORTEST:g}")
        for name in ("every", "starts"):
            integer(name, getattr(self, name), 1)


def clean_walking(
    act: Callable[[NDArray[np.float32]], NDArray[Any]],
    envs: RimlessWheelVectorEnv,
    intervals: int,
) -> CleanWalking:
    """How a policy walks from starts of its own, in the second half of so many intervals.

    Args:
        act: observations (N, 6 or 8) -> actions (N, 1).
        envs: whose rows reset themselves in the step that ends an episode.
        intervals: length of the walks; an episode that ends before has fallen.
    """
    seen, _ = envs.reset(seed=0)
    machines = envs.params
    friction = np.array([machine.friction for machine in machines])
    weight = np.array([machine.weight for machine in machines])
    walks = np.ones(envs.num_envs, dtype=bool)
    steps, distance, energy, time = (np.zeros(envs.num_envs) for _ in range(4))
    for interval in range(intervals):
        seen, _, ended, timed_out, info = envs.step(act(seen))
        walks &= ~(ended | timed_out)
        if interval < intervals // 2:
            continue
        demand = np.maximum(info["friction_demand"], info["impulse_friction_demand"])
        walks &= ~exceeds(demand, friction)
        steps += info["steps"]
        distance += info["distance"]
        energy += info["electrical_positive"] + info["idle"]
        time += info["elapsed"]
    walks &= (steps >= FEWEST_STEPS) & (distance > 0.0)
    if not walks.any():
        return NO_WALK
    return CleanWalking(
        float(walks.mean()),
        float(energy[walks].sum() / (weight * distance)[walks].sum()),
        float(distance[walks].sum() / time[walks].sum()),
    )


class SelfPacedPrice(BaseCallback):
    """Pays a price of distance that follows what the policy's own walking costs.

    It begins high, so that walking pays at once, and falls to a multiple of the cost of transport
    of the deterministic policy, once enough starts walk; never below the environment's own price,
    unless `least_price` says so.
    Travel is paid only up to a speed. It logs `pacing/price`, `pacing/share`, `pacing/cot` and
    `pacing/speed`.

    It begins anew with every new training. Only VecNormalize may stand between what the
    environments show and what the policy sees.

    The policy is looked at on the machine of the first row, without ranges and disturbances. It
    decides in every control period there, even where `HeldActions` hold its actions in training.

    Args:
        pacing: how; default: a `Pacing` of `settings`.
        settings: fields of `Pacing`, as rl-zoo3 gives them.

    Attributes:
        pacing: how.
        price: that is paid now; None before a training has begun.

    Raises:
        TypeError: there are both, or a setting is unknown or of the wrong kind.
        ValueError: a setting is out of range.
    """

    def __init__(self, pacing: Pacing | None = None, **settings: Any) -> None:
        super().__init__()
        if not isinstance(pacing, Pacing | None):
            raise TypeError(f"pacing = {pacing!r}: must be a Pacing; or name its fields")
        if pacing is not None and settings:
            raise TypeError(f"pacing and {list(settings)}: give one of them")
        self.pacing = pacing or Pacing(**settings)
        self.price: float | None = None
        self._due = self.pacing.every
        self._envs: VecEnv | None = None
        self._task: Task | None = None  # theirs; after a stop they may still pay another one
        self._probe: RimlessWheelVectorEnv | None = None

    def _init_callback(self) -> None:
        envs = self.training_env
        if self.model.num_timesteps == 0:
            self.price, self._due = None, self.pacing.every
        if self._task is None or envs.unwrapped is not self._envs:
            self._envs, self._task = envs.unwrapped, envs.get_attr("task")[0]
            self._probe = probe_of(envs, self.pacing.starts)
        if self.price is None:
            self.price = max(self.pacing.first_price, self._least_price(self._task))
        self._pay(self.price, self._task)

    def _least_price(self, task: Task) -> float:
        """Below which the price never falls; the environments pay by `task`."""
        return self.pacing.least_price or task.distance_weight

    def _pay(self, price: float, task: Task) -> None:
        """Let the environments pay a price from now on, and the rest as told or as a task does."""
        assert self._probe is not None
        target = min(self.pacing.paid_speed, task.target_speed)
        paid = dataclasses.replace(
            task,
            distance_weight=price,
            # A command takes its place.
            target_speed=math.inf if self._probe.control.speeds else target,
            fall_penalty=self.pacing.fall_penalty,
            slip_penalty=self.pacing.slip_penalty,
        )
        self.training_env.env_method("set_task", paid)

    def _on_rollout_start(self) -> None:
        if self.num_timesteps < self._due:
            return
        assert self._task is not None
        assert self._probe is not None
        assert self.price is not None
        self._due = self.num_timesteps + self.pacing.every
        intervals = round(self.pacing.seconds / self._probe.control.period)
        walking = clean_walking(self._act, self._probe, intervals)
        self.price = paced_price(
            self.price,
            walking,
            self._least_price(self._task),
            self.pacing.least_share,
            self.pacing.multiple,
            self.pacing.margin,
        )
        self._pay(self.price, self._task)
        self.logger.record("pacing/price", self.price)
        for name, value in walking._asdict().items():
            if math.isfinite(value):  # what does not walk has no cost of transport
                self.logger.record(f"pacing/{name}", value)

    def _act(self, observations: NDArray[np.float32]) -> NDArray[Any]:
        normalizer = self.model.get_vec_normalize_env()
        seen = observations if normalizer is None else normalizer.normalize_obs(observations)
        actions: NDArray[Any] = self.model.predict(np.asarray(seen), deterministic=True)[0]
        return actions

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self.training_env.env_method("set_task", self._task)

    def state(self) -> dict[str, Any]:
        """All that later prices depend on besides the policy, plain values."""
        return {"price": self.price, "due": self._due}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state when the training begins."""
        self.price, self._due = state["price"], int(state["due"])


def probe_of(envs: VecEnv, starts: int) -> RimlessWheelVectorEnv:
    """Environments like those of a training, with the usual starts, to look at its policy in."""
    (control,) = envs.get_attr("control", [0])
    kind, commanded = RimlessWheelVectorEnv, {}
    if control.speeds is not None:
        kind, commanded = RimlessWheelSpeedVectorEnv, {"speeds": control.speeds}
    return kind(
        starts,
        envs.get_attr("params", [0])[0],
        max_episode_steps=None,
        autoreset_mode=AutoresetMode.SAME_STEP,
        control_period=control.period,
        actions=control.actions,
        **commanded,
    )
