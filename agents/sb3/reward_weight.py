"""An adaptive reward weight of distance for any learner of stable-baselines3 in our environments.

    envs = Sb3VecEnv(gym.make_vec("RimlessWheel-v0", num_envs=64, autoreset_mode="SameStep"))
    model = PPO("MlpPolicy", HeldActions(VecMonitor(envs), 4), gamma=0.98)
    model.learn(2_000_000, AdaptiveRewardWeight(first_weight=5.0))

`agents.reward_weight` and docs/learning.md explain why the weight must adapt.
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

from agents.reward_weight import (
    FEWEST_STEPS,
    LEAST_SHARE,
    MULTIPLE,
    NO_WALK,
    CleanWalking,
    adapted_weight,
)
from rimless_gym import RimlessWheelSpeedVectorEnv, RimlessWheelVectorEnv
from rimless_gym.checks import integer, not_negative, positive
from rimless_gym.envs.task import Task
from rimless_gym.rules import exceeds

#: The shortest walk in which a policy can be measured (s): some control periods of any length.
SHORTEST = 0.4


@dataclasses.dataclass(frozen=True)
class WeightSchedule:
    """How the reward weight of distance follows the policy.

    Attributes:
        first_weight: reward per metre at first; it falls with the policy's own cost of transport.
        least_share: of starts that must walk before the weight falls.
        multiple: of the policy's own cost of transport, which the weight becomes; greater than 1.
            With a small one, a policy may stay with a slow gait that costs much for its speed.
        margin: the most that the weight exceeds the policy's own cost of transport (reward per
            metre); by default there is no limit. A small one leads away from costly gaits sooner.
        least_weight: below which it never falls; None: the environment's own. Near the optimum a
            lower one lets the reward depend more on energy.
        rewarded_speed: speed up to which travel is rewarded in training (m/s), so that running is
            not rewarded however high the weight is.
        fall_penalty: travel forfeited by an early end in training (m), instead of the task's own.
            With a high weight 2 m make resting safer than walking.
        slip_penalty: travel forfeited per second of slipping in training (m/s), likewise. A high
            one keeps a policy from slipping a little at every touchdown.
        every: time steps, of all environments together, between two checks of the policy.
        starts: from which it then walks.
        seconds: for how long; the second half is measured.

    Raises:
        TypeError: a value is not a number.
        ValueError: a value is out of range.
    """

    first_weight: float = 20.0
    least_share: float = LEAST_SHARE
    multiple: float = MULTIPLE
    margin: float = math.inf
    least_weight: float | None = None
    rewarded_speed: float = 0.6
    fall_penalty: float = 0.5
    slip_penalty: float = 1.0
    every: int = 100_000
    starts: int = 64
    seconds: float = 8.0

    def __post_init__(self) -> None:
        for name in ("first_weight", "least_share", "fall_penalty", "slip_penalty"):
            not_negative(name, getattr(self, name))
        if self.least_weight is not None:
            positive("least_weight", self.least_weight)
        if self.margin != math.inf:
            positive("margin", self.margin)
        for name in ("multiple", "rewarded_speed"):
            positive(name, getattr(self, name))
        if positive("seconds", self.seconds) < SHORTEST:
            raise ValueError(f"seconds = {self.seconds:g}: must be at least {SHORTEST:g}")
        for name in ("every", "starts"):
            integer(name, getattr(self, name), 1)


class AdaptiveRewardWeight(BaseCallback):
    """Rewards distance with a weight that follows what the policy's own walking costs.

    It begins high, so that walking is rewarded at once, and falls to a multiple of the cost of
    transport of the deterministic policy, once enough starts walk; never below the environment's
    own weight, unless `least_weight` says so. Travel is rewarded only up to a speed. It logs
    `reward_weight/distance`, `reward_weight/share`, `reward_weight/cot` and `reward_weight/speed`.

    It begins anew with every new training. Only VecNormalize may stand between the observations of
    the environments and those of the policy.

    The policy is checked with the parameters of the first row, without ranges and disturbances. It
    decides in every control period there, even where `HeldActions` hold its actions in training.

    Args:
        settings: fields of `WeightSchedule` that differ from its own.

    Attributes:
        schedule: how.
        weight: that is in use; None before a training has begun.

    Raises:
        TypeError: a setting is unknown or of the wrong kind.
        ValueError: a setting is out of range.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__()
        self.schedule = WeightSchedule(**settings)
        self.weight: float | None = None
        self._due = self.schedule.every
        self._envs: VecEnv | None = None
        self._task: Task | None = None  # theirs; after a stop they may still have another one
        self._probe: RimlessWheelVectorEnv | None = None

    def _init_callback(self) -> None:
        envs = self.training_env
        if self.model.num_timesteps == 0:
            self.weight, self._due = None, self.schedule.every
        if self._task is None or envs.unwrapped is not self._envs:
            self._envs, self._task = envs.unwrapped, envs.get_attr("task")[0]
            self._probe = _probe_of(envs, self.schedule.starts)
        if self.weight is None:
            self.weight = max(self.schedule.first_weight, self._least_weight(self._task))
        self._set(self.weight, self._task)

    def _least_weight(self, task: Task) -> float:
        """Below which the weight never falls, where `task` is that of the environments."""
        return self.schedule.least_weight or task.distance_weight

    def _set(self, weight: float, task: Task) -> None:
        """Let the environments reward with a weight from now on."""
        assert self._probe is not None
        speed = min(self.schedule.rewarded_speed, task.target_speed)
        changed = dataclasses.replace(
            task,
            distance_weight=weight,
            # A command takes its place.
            target_speed=math.inf if self._probe.control.speeds else speed,
            fall_penalty=self.schedule.fall_penalty,
            slip_penalty=self.schedule.slip_penalty,
        )
        self.training_env.env_method("set_task", changed)

    def _on_rollout_start(self) -> None:
        if self.num_timesteps < self._due:
            return
        assert self._task is not None
        assert self._probe is not None
        assert self.weight is not None
        self._due = self.num_timesteps + self.schedule.every
        intervals = round(self.schedule.seconds / self._probe.control.period)
        walking = clean_walking(self._act, self._probe, intervals)
        self.weight = adapted_weight(
            self.weight,
            walking,
            self._least_weight(self._task),
            self.schedule.least_share,
            self.schedule.multiple,
            self.schedule.margin,
        )
        self._set(self.weight, self._task)
        self.logger.record("reward_weight/distance", self.weight)
        for name, value in walking._asdict().items():
            if math.isfinite(value):  # without a walk there is no cost of transport
                self.logger.record(f"reward_weight/{name}", value)

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
        """All that later weights depend on besides the policy, plain values."""
        return {"weight": self.weight, "due": self._due}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state when the training begins."""
        self.weight, self._due = state["weight"], int(state["due"])


def clean_walking(
    act: Callable[[NDArray[np.float32]], NDArray[Any]],
    envs: RimlessWheelVectorEnv,
    intervals: int,
) -> CleanWalking:
    """How a policy walks from starts of its own, in the second half of so many intervals.

    Its actions are (N, 1). The rows of `envs` reset themselves in the step that ends an episode; a
    wheel whose episode ends before has fallen.
    """
    seen, _ = envs.reset(seed=0)
    params = envs.params
    friction = np.array([each.friction for each in params])
    weight = np.array([each.weight for each in params])
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


def _probe_of(envs: VecEnv, starts: int) -> RimlessWheelVectorEnv:
    """Environments like those of a training, with the usual starts, to check its policy in."""
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
