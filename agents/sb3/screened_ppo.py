"""PPO of stable-baselines3 that goes on from screened random policies.

No small change leads from leaning to the efficient gaits, in which the pendulum makes a revolution
per step: PPO that begins with an untrained network never finds them. So thousands of random
policies are screened first, as evolution does it (`agents.evolution.search`). PPO then improves
some of every family of gaits in a short trial and the best of them in two longer rounds, and goes
on with the best of all (`agents.sb3.rounds`).

The screening takes about 50 million control intervals, which do not count as time steps.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO

from agents import learner
from agents.conditions import Conditions, require_usual
from agents.evolution.search import EvolutionSettings, answered, screen
from agents.evolution.walks import SIZE, Duration, PolicySimulator, WalkReward, act, families
from agents.learner import (
    LAST,
    NO_CHANGES,
    SCRATCH,
    Callback,
    LearnerSettings,
    PolicyParts,
    Training,
)
from agents.policies import Act, learned_policy
from agents.reward_weight import NO_WALK, CleanWalking
from agents.rollout import Rollout, draw_starts
from agents.sb3.hyperparameters import Hyperparameters
from agents.sb3.learner import Actor, Sb3Learner, model_state, restore_model
from agents.sb3.reward_weight import AdaptiveRewardWeight, WeightSchedule
from agents.sb3.rounds import (
    Improve,
    KeepBest,
    NormalizeByPhase,
    Products,
    Tournament,
    policy_of,
    put_policy,
    score,
)
from agents.sb3.wrappers import (
    ScaledReward,
    StartUpPhase,
    begin_out_of_step,
    wrapped,
)
from rimless_gym.envs.task import Task
from trajopt.feedback.law import Floats

#: How policies are screened.
SCREENING = EvolutionSettings()

#: Candidates of each family.
CANDIDATES = 4

#: The walks by which candidates are compared, their starts, and the seed of these.
COMPARED, COMPARED_STARTS, COMPARED_SEED = Duration.second_half(2000), 128, 4

#: Checks of the policy that is left: its walks and starts, and the time steps between two.
CHECK, CHECK_STARTS, CHECK_SEED, CHECK_EVERY = Duration.second_half(3000), 256, 6, 524_288

#: The walks over which products are whitened.
WHITENED_STARTS, WHITENED_INTERVALS, WHITENED_SEED = 64, 1000, 5

#: The share of starts that must walk before the weight of distance falls, while candidates are
#: compared. The weight of a policy that rests or falls from some starts would stay high otherwise,
#: and its gait costly. What it lacks is mended at the end.
RACING_SHARE = 0.5


class ScreenedPpo(Sb3Learner):
    """Screens random policies, and improves some of every family, then the best of them, by PPO."""

    algorithm = PPO
    recommended = LAST  # the best of many checks from many starts
    hyperparameter_file = "screened_ppo.yml"

    def __init__(self, training: Training, start: PolicyParts | None = None) -> None:
        conditions = training.conditions
        require_usual("screened_ppo", conditions)
        super().__init__(training)
        schedule = getattr(training.settings, "schedule", None)
        if schedule is None or self._arguments.get("normalize_advantage", True):
            raise ValueError(
                "screened_ppo: needs an AdaptiveRewardWeight as callback, and normalize_advantage: "
                "false; leave both as they are in screened_ppo.yml"
            )
        self._schedule: WeightSchedule = schedule
        self._backward_penalty = wrapped(self._env, StartUpPhase).penalty
        self._simulator = PolicySimulator(conditions.params)
        self._objective = WalkReward(conditions.params, training.task, SCREENING.rewarded_speed)
        self._race, self._begun = Tournament(np.zeros((0, SIZE)), np.zeros(0, dtype=np.int64)), 0
        self._adaptive = self._new_weight(schedule.first_weight)
        self._kept = KeepBest(self._checked, CHECK_EVERY)
        put_policy(self.model.policy, np.zeros(SIZE))
        if start is not None:
            weights = start.weights["weights"].astype(np.float64).reshape(SIZE)
            self._race = Tournament.last_round(weights)
            self._begin()

    @classmethod
    def settings(cls, init: str, changes: Mapping[str, Any] = NO_CHANGES) -> LearnerSettings:
        """The entry of the file, for every start."""
        settings = super().settings(SCRATCH, changes)
        assert isinstance(settings, Hyperparameters)
        if callable(settings.algorithm["learning_rate"]):
            raise ValueError(
                "learning_rate: must be a number here; from round to round it falls by itself"
            )
        if layers := settings.algorithm["policy_kwargs"].get("net_arch", {}).get("pi"):
            raise ValueError(
                f"net_arch: pi = {layers}: must be empty, since the policy is linear; vf is free"
            )
        networks = settings.algorithm["policy_kwargs"] | {"features_extractor_class": Products}
        algorithm = settings.algorithm | {"policy_kwargs": networks}
        return dataclasses.replace(settings, algorithm=algorithm)

    @classmethod
    def load(cls, parts: PolicyParts, conditions: Conditions, task: Task) -> Act:
        """The policy in `parts`."""
        return functools.partial(act, parts.weights["weights"].reshape(SIZE))

    @staticmethod
    def actor(model: Any) -> Actor:
        """The last layer; its noise is the same in all states."""
        network = model.policy

        def mean_action(observations: torch.Tensor) -> torch.Tensor:
            return network.action_net(network.extract_features(observations))[:, 0]

        def set_noise(log_std: float) -> None:
            with torch.no_grad():
                network.log_std.fill_(log_std)

        layer = list(network.action_net.parameters())
        return Actor(model, mean_action, layer, [network.log_std], set_noise)

    imitate = learner.Learner.imitate  # a network cannot be cloned into its products

    @property
    def act(self) -> Act:
        """The deterministic policy; it does nothing before one was found.

        Once one candidate is left, it is the best of its checks.
        """
        return functools.partial(act, self._best_weights)

    @property
    def _best_weights(self) -> Floats:
        kept = self._kept.weights
        return policy_of(self.model.policy) if kept is None else kept

    def learn(self, until: int, callback: Callback) -> None:
        """Learn until there have been `until` steps; a roll-out that was begun is ended."""
        if self.steps < until and not len(self._race.candidates):
            self._race = self._screened(callback)
            self._begin()
        while self.steps < until:
            lasts = self._race.rules.steps
            ends = until if lasts is None else self._begun + lasts
            self._improve(min(ends, until), ends, callback)
            if lasts is not None and self.steps >= ends:
                weights = policy_of(self.model.policy)
                self._race.advance(weights, self._compared(weights))
                self._begin()

    def _screened(self, callback: Callback) -> Tournament:
        """A race of the best random policies of each family."""
        callback.on_phase(f"screening {SCREENING.screened} random policies")
        search = screen(SCREENING, self.training.seed)
        request = next(search)
        while True:
            callback.on_iteration()
            try:
                request = search.send(answered(request, self._simulator, self._objective))
            except StopIteration as end:
                screened = end.value
                break
        candidates, of_families = [], []
        for family, policies in screened.items():
            gaits = [self._compared(weights) for weights in policies]
            order = sorted(range(len(gaits)), key=lambda k: -score(gaits[k]))
            candidates += [policies[k] for k in order[:CANDIDATES]]
            of_families += [family] * len(order[:CANDIDATES])
        callback.on_phase("")
        return Tournament(np.array(candidates), np.array(of_families))

    def _begin(self) -> None:
        """Begin to improve the next candidate, with a new critic."""
        weights, steps = self._race.candidate, self.steps
        self._begun = steps
        self.model = self._new_model({})
        self.model.num_timesteps = steps
        self.model.policy.features_extractor.whiten(self._observed_by(weights))
        put_policy(self.model.policy, weights)
        observations = begin_out_of_step(self._env, functools.partial(act, weights))
        self.model._last_obs = observations
        self.model._last_episode_starts = np.ones(len(observations), dtype=bool)
        self._adaptive = self._new_weight(self._schedule.multiple * self._compared(weights).cot)

    def _new_weight(self, weight: float) -> AdaptiveRewardWeight:
        """What adapts the weight from now on: at first it is `weight`, or the schedule's first."""
        share = self._schedule.least_share
        schedule = dataclasses.replace(
            self._schedule,
            first_weight=min(self._schedule.first_weight, weight),
            least_share=share if self._race.decided else min(share, RACING_SHARE),
        )
        adaptive = AdaptiveRewardWeight(**vars(schedule))
        adaptive.restore({"weight": None, "due": self._begun + self._schedule.every})
        return adaptive

    def _observed_by(self, weights: Floats) -> NDArray[np.float32]:
        """What a policy observes on its walks, (N, 6)."""
        seed = (self.training.seed, WHITENED_SEED)
        starts = draw_starts(self._simulator.params, WHITENED_STARTS, seed)
        policy = learned_policy(functools.partial(act, weights))
        walks = Rollout(self.training.conditions, policy, starts, WHITENED_INTERVALS)
        return np.concatenate([interval.observations for interval in walks])

    def _improve(self, until: int, ends: int, callback: Callback) -> None:
        model, rules, decided = self.model, self._race.rules, self._race.decided
        wrapped(self._env, StartUpPhase).penalty = self._backward_penalty if decided else 0.0
        assert self._adaptive is not None
        improve = Improve(
            self.actor(model),
            rules,
            float(self._arguments["learning_rate"]),
            (self._begun, self._begun + rules.critic_first * model.n_steps * model.n_envs, ends),
            wrapped(self._env, ScaledReward),
            self._adaptive,
        )
        normalize = NormalizeByPhase(wrapped(self._env, StartUpPhase))
        callbacks = [self._adaptive, improve, normalize, *([self._kept] if decided else [])]
        self._learn(until, callback, callbacks)

    def _compared(self, weights: Floats) -> CleanWalking:
        """How a policy (SIZE,) walks, where candidates are compared."""
        return self._walked(weights, COMPARED_STARTS, COMPARED_SEED, COMPARED)

    def _checked(self, weights: Floats) -> CleanWalking:
        """How a policy (SIZE,) walks, where the best is kept."""
        return self._walked(weights, CHECK_STARTS, CHECK_SEED, CHECK)

    def _walked(self, weights: Floats, n: int, seed: int, duration: Duration) -> CleanWalking:
        """How a policy (SIZE,) walks, in the family of gaits in which it walks best."""
        starts = draw_starts(self._simulator.params, n, (self.training.seed, seed))
        walks = self._simulator.walk(weights[None], starts, duration)
        gaits = [self._objective.gait(walks, duration, family) for family in families(walks)]
        return max(gaits, key=score, default=NO_WALK)

    def parts(self) -> PolicyParts:
        """The weights of the policy that `act` is."""
        return PolicyParts({}, {"weights": self._best_weights})

    def state(self) -> dict[str, Any]:
        """The race, and all of the model that learns, between two roll-outs."""
        assert self._adaptive is not None
        return {
            "race": dataclasses.asdict(self._race),
            "begun": self._begun,
            "adaptive": self._adaptive.state(),
            "kept": self._kept.state(),
            **model_state(self.model),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self._race = Tournament.read(state["race"])
        self._begun = int(state["begun"])
        restore_model(self.model, state)
        # Before the first time step, the callback begins at the first weight whatever it restored.
        adaptive = state["adaptive"]
        self._adaptive = self._new_weight(adaptive["weight"] or self._schedule.first_weight)
        self._adaptive.restore(adaptive)
        self._kept.restore(state["kept"])
