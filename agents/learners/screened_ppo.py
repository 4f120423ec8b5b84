"""PPO of stable-baselines3 that goes on from screened random policies.

No small change leads from leaning to the cheap gaits, in which the pendulum turns once per step:
PPO that begins with an untrained network never finds them. So thousands of random policies are
screened first, as evolution does it (`agents.evolution.screening`). PPO then improves some of every
family of gaits in a short trial and the best of them in two longer heats, and settles with the best
of all (`agents.sb3.stages`).

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
from stable_baselines3.common.callbacks import BaseCallback

from agents.conditions import Conditions, require_usual
from agents.evolution import policy
from agents.evolution.answering import answered
from agents.evolution.policy import SIZE
from agents.evolution.screening import screen
from agents.evolution.settings import EvolutionSettings
from agents.evolution.walks import Duration, World
from agents.evolution.worth import Worth, families
from agents.folder import LAST
from agents.learner import NO_CHANGES, PolicyParts, Watch
from agents.pacing import NO_WALK, CleanWalking
from agents.policies import Act, learned_policy
from agents.rollout import Rollout, draw_starts
from agents.sb3.callbacks import Freeze, InMetres, LogWalking, Settle, Watched
from agents.sb3.hard_starts import HardStarts
from agents.sb3.hyperparameters import Hyperparameters
from agents.sb3.kept import KeepBest
from agents.sb3.layers import layer_of
from agents.sb3.learner import Sb3Learner
from agents.sb3.networks import Actor
from agents.sb3.pacing import Pacing, SelfPacedPrice
from agents.sb3.products import Products, policy_of, put_policy
from agents.sb3.setting_off import CountApart, SettingOff
from agents.sb3.stages import RACING_SHARE, Contest, promise
from agents.sb3.state import begin_at, restore, state_of
from agents.sb3.stepping_back import SteppingBack
from agents.sb3.training_env import ScaledReward, begin_out_of_step
from agents.sb3.vec_env import Sb3VecEnv
from agents.training import SCRATCH, Settings, Training
from rimless_gym.envs.task import Task
from trajopt.feedback.law import Floats

#: How policies are screened.
SCREENING = EvolutionSettings()

#: Contenders of each family.
CONTENDERS = 4

#: The walks by which policies are compared, and their starts.
COMPARED, COMPARED_STARTS = Duration.judged_in_second_half(2000), 128

#: Looks at the policy that settles: their walks and starts, and the time steps between two.
LOOK, LOOK_STARTS, LOOK_EVERY = Duration.judged_in_second_half(3000), 256, 524_288

#: The walks over which products are whitened.
SEEN_STARTS, SEEN_INTERVALS = 64, 1000


class Learner(Sb3Learner):
    """Screens random policies, and improves some of every family, then the best of them, by PPO.

    Raises:
        TypeError: the training's settings are not `Hyperparameters`.
        ValueError: there are ranges or disturbances, a commanded speed, or another control period;
            or the settings have no pacing of the price, or normalise all advantages together.
    """

    algorithm = PPO
    imitates = False
    recommended = LAST  # the best of many looks from many starts
    hyperparameter_file = "screened_ppo.yml"

    def __init__(self, training: Training, start: PolicyParts | None = None) -> None:
        conditions = training.conditions
        require_usual("screened_ppo", conditions)
        super().__init__(training)
        pacing = getattr(training.settings, "pacing", None)
        if pacing is None:
            raise ValueError(
                "callback: lists no agents.sb3.pacing.SelfPacedPrice: at the task's own price, "
                "clumsy policies learn to rest; leave it as it is in screened_ppo.yml"
            )
        if self._arguments.get("normalize_advantage", True):
            raise ValueError(
                "normalize_advantage = true: advantages of setting off and of the gait are "
                "normalised apart; leave it false, as it is in screened_ppo.yml"
            )
        self._pacing: Pacing = pacing
        self._back_charge = layer_of(self._env, SteppingBack).charge
        self._hard_starts = layer_of(self._env, HardStarts).share
        self._world = World(conditions.params)
        self._worth = Worth(conditions.params, training.task, SCREENING.paid_speed)
        self._contest, self._begun = Contest(np.zeros((0, SIZE)), np.zeros(0, dtype=np.int64)), 0
        self._paced = self._new_pace(self._pacing.first_price)
        self._kept = KeepBest(self._looked_at, LOOK_EVERY)
        put_policy(self.model.policy, np.zeros(SIZE))
        if start is not None:
            weights = start.weights["weights"].astype(np.float64).reshape(SIZE)
            self._enter(Contest.settling(weights))

    @classmethod
    def settings(cls, init: str, changes: Mapping[str, Any] = NO_CHANGES) -> Settings:
        """The entry of the file, for every start."""
        found = super().settings(SCRATCH, changes)
        assert isinstance(found, Hyperparameters)
        if callable(found.algorithm["learning_rate"]):
            raise ValueError(
                "learning_rate: must be a number here; from stage to stage it falls by itself"
            )
        if layers := found.algorithm["policy_kwargs"].get("net_arch", {}).get("pi"):
            raise ValueError(
                f"net_arch: pi = {layers}: must be empty, since the policy is linear; vf is free"
            )
        networks = found.algorithm["policy_kwargs"] | {"features_extractor_class": Products}
        algorithm = found.algorithm | {"policy_kwargs": networks}
        return dataclasses.replace(found, algorithm=algorithm)

    @classmethod
    def load(cls, parts: PolicyParts, conditions: Conditions, task: Task) -> Act:
        """The policy in `parts`."""
        return functools.partial(policy.act, parts.weights["weights"].reshape(SIZE))

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

    @property
    def _weights(self) -> Floats:
        return policy_of(self.model.policy)

    @property
    def act(self) -> Act:
        """The deterministic policy; it does nothing before one was found.

        Once a policy settles, it is the best that was looked at.
        """
        return functools.partial(policy.act, self._best_weights)

    @property
    def _best_weights(self) -> Floats:
        kept = self._kept.weights
        return self._weights if kept is None else kept

    def learn(self, until: int, watch: Watch) -> None:
        """Learn until there have been `until` steps; a roll-out that was begun is ended."""
        if self.steps < until and not len(self._contest.contenders):
            self._enter(self._screened(watch))
        while self.steps < until:
            lasts = self._contest.rules.steps
            turn_ends = until if lasts is None else self._begun + lasts
            self._improve(min(turn_ends, until), turn_ends, watch)
            if lasts is not None and self.steps >= turn_ends:
                self._contest.end_turn(self._weights, self._gait_of(self._weights))
                self._begin()

    def _screened(self, watch: Watch) -> Contest:
        """A contest of the best random policies of each family."""
        watch.doing(f"screening {SCREENING.screened} random policies")
        search = screen(SCREENING, self.training.seed)
        request = next(search)
        while True:
            watch.between()
            try:
                request = search.send(answered(request, self._world, self._worth))
            except StopIteration as end:
                found = end.value
                break
        contenders, families = [], []
        for family, policies in found.items():
            gaits = [self._gait_of(weights) for weights in policies]
            order = sorted(range(len(gaits)), key=lambda k: -promise(gaits[k]))
            contenders += [policies[k] for k in order[:CONTENDERS]]
            families += [family] * len(order[:CONTENDERS])
        watch.doing("")
        return Contest(np.array(contenders), np.array(families))

    def _enter(self, contest: Contest) -> None:
        """Begin a contest, or go on with one, with the policy whose turn it is."""
        self._contest = contest
        self._begin()

    def _begin(self) -> None:
        """Begin to improve the policy whose turn it is, with a new critic."""
        weights, steps = self._contest.contender, self.steps
        self._begun = steps
        self.model = self._new_model({})
        self.model.num_timesteps = steps
        self.model.policy.features_extractor.whiten(self._seen_by(weights))
        put_policy(self.model.policy, weights)
        act = functools.partial(policy.act, weights)
        begin_at(self.model, begin_out_of_step(self._env, act))
        self._paced = self._new_pace(self._pacing.multiple * self._gait_of(weights).cot)

    def _new_pace(self, price: float) -> SelfPacedPrice:
        """What paces the price from now on: at first it is `price`, or the pacing's first one."""
        first = min(self._pacing.first_price, price)
        share = self._pacing.least_share
        if not self._contest.settles:
            share = min(share, RACING_SHARE)
        pacing = dataclasses.replace(self._pacing, first_price=first, least_share=share)
        paced = SelfPacedPrice(pacing)
        paced.restore({"price": None, "due": self._begun + self._pacing.every})
        return paced

    def _seen_by(self, weights: Floats) -> NDArray[np.float32]:
        """What a policy observes on its walks, (N, 6)."""
        starts = draw_starts(self._world.params, SEEN_STARTS, (self.training.seed, 5))
        act = learned_policy(functools.partial(policy.act, weights))
        walks = Rollout(self.training.conditions, act, starts, SEEN_INTERVALS)
        return np.concatenate([interval.observations for interval in walks])

    def _improve(self, until: int, ends: int, watch: Watch) -> None:
        model, stage, settles = self.model, self._contest.rules, self._contest.settles
        model.set_logger(watch.log)
        critic_first = self._begun + stage.critic_first * model.n_steps * model.n_envs
        actor, rate = self.actor(model), float(self._arguments["learning_rate"])
        rates = rate, stage.last_rate * rate
        layer_of(self._env, SteppingBack).charge = self._back_charge if settles else 0.0
        layer_of(self._env, HardStarts).share = self._hard_starts if settles else 0.0
        callbacks: list[BaseCallback] = [
            LogWalking(self.training.conditions.params, layer_of(self._env, Sb3VecEnv)),
            *(
                Watched(watch),
                self._paced,
                InMetres(layer_of(self._env, ScaledReward), self._paced),
            ),
            CountApart(layer_of(self._env, SettingOff)),
            Freeze(actor, critic_first),
            Settle(actor, stage.noise, rates, self._begun, ends),
        ]
        if settles:
            callbacks.append(self._kept)
        model.learn(until - self.steps, callbacks, reset_num_timesteps=False)

    def _gait_of(self, weights: Floats) -> CleanWalking:
        """How a policy (SIZE,) walks, where contenders are compared."""
        starts = draw_starts(self._world.params, COMPARED_STARTS, (self.training.seed, 4))
        return self._walked(weights, starts, COMPARED)

    def _looked_at(self, weights: Floats) -> CleanWalking:
        """How a policy (SIZE,) walks, where the best is kept."""
        starts = draw_starts(self._world.params, LOOK_STARTS, (self.training.seed, 6))
        return self._walked(weights, starts, LOOK)

    def _walked(self, weights: Floats, starts: Floats, duration: Duration) -> CleanWalking:
        """How a policy (SIZE,) walks, in the family of gaits in which it walks best."""
        walks = self._world.walk(weights[None], starts, duration)
        gaits = [self._worth.gait(walks, duration, family) for family in families(walks)]
        return max(gaits, key=promise, default=NO_WALK)

    def parts(self) -> PolicyParts:
        """The weights of the policy that `act` is."""
        return PolicyParts({}, {"weights": self._best_weights})

    def state(self) -> dict[str, Any]:
        """The contest, and all of the model that learns, between two roll-outs."""
        return {
            "contest": self._contest.state(),
            "begun": self._begun,
            "price": self._paced.state(),
            "kept": self._kept.state(),
            **state_of(self.model),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self._contest = Contest.read(state["contest"])
        self._begun = int(state["begun"])
        restore(self.model, state)
        # Before the first time step, the callback begins at the first price whatever it restored.
        self._paced = self._new_pace(state["price"]["price"] or self._pacing.first_price)
        self._paced.restore(state["price"])
        self._kept.restore(state["kept"])
