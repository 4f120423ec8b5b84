"""PPO of stable-baselines3 that goes on from screened random policies.

No small change leads from leaning to the cheap gaits, in which the pendulum turns once per step:
PPO that begins with an untrained network never finds them. So thousands of random policies are
screened first, as evolution does it (`agents.evolution.screening`). Of every family of gaits, PPO
then improves the policy that walks best, all for the same time, and goes on with the cheapest.

The screening takes about 50 million control intervals, which do not count as time steps.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from pathlib import Path
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
from agents.imitation import CloneReport, Cloning
from agents.learner import NO_CHANGES, PolicyParts, Watch
from agents.pacing import NO_WALK, CleanWalking
from agents.policies import Act, Policy, learned_policy
from agents.rollout import Rollout, draw_starts
from agents.sb3.callbacks import Freeze, InMetres, LogWalking, Settle, Watched
from agents.sb3.hyperparameters import Hyperparameters
from agents.sb3.learner import Sb3Learner
from agents.sb3.networks import Actor
from agents.sb3.pacing import Pacing, SelfPacedPrice
from agents.sb3.products import Products, policy_of, put_policy
from agents.sb3.state import restore, state_of
from agents.sb3.training_env import native_of
from agents.scores import economy
from agents.training import SCRATCH, Settings, Training
from rimless_gym.envs.task import Task
from trajopt.feedback.law import Floats

#: How policies are screened.
SCREENING = EvolutionSettings()

#: Time steps for which PPO improves the best policy of each family before they are compared.
TRIAL = 4_000_000

#: A policy takes part if it walks from this share of the starts before PPO improves it.
LEAST_SHARE = 0.1

#: How the noise falls in the race, and after it: standard deviations, in units of the limit. The
#: gait that is best under noise is not the one that is best without. But to leave clumsy gaits
#: takes more noise than cheap ones stand.
RACING_NOISE, LAST_NOISE = (0.1, 0.06), (0.06, 0.02)

#: The price of distance after the race begins at this multiple of the best policy's cost. The price
#: is looked at again in the first roll-out, so it stays so high only if too few starts walk.
NEXT_MULTIPLE = 4.0

#: To what share of itself the learning rate falls after the race.
LAST_RATE = 0.2

#: Roll-outs at the beginning of each turn in which only the critic learns. A critic that has only
#: begun to learn spoils a good policy within a minute.
CRITIC_FIRST = 16

#: The walks by which policies are compared, and their starts.
COMPARED, COMPARED_STARTS = Duration.judged_in_second_half(2000), 128

#: The walks over which products are whitened.
SEEN_STARTS, SEEN_INTERVALS = 64, 1000


class Learner(Sb3Learner):
    """Screens random policies, improves the best of every family by PPO, then the cheapest.

    Raises:
        TypeError: the training's settings are not `Hyperparameters`.
        ValueError: there are ranges or disturbances, a commanded speed, or another control period;
            or the settings have no pacing of the price.
    """

    algorithm = PPO
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
        self._pacing: Pacing = pacing
        self._world = World(conditions.params)
        self._worth = Worth(conditions.params, training.task, SCREENING.paid_speed)
        self._contenders, self._gaits = np.zeros((0, SIZE)), np.zeros((0, 3))
        self._begun, self._paced = 0, SelfPacedPrice(self._pacing)
        put_policy(self.model.policy, np.zeros(SIZE))
        if start is not None:
            self._race(start.weights["weights"].astype(np.float64).reshape(1, SIZE))

    @classmethod
    def settings(cls, init: str, changes: Mapping[str, Any] = NO_CHANGES) -> Settings:
        """The entry of the file, for every start."""
        found = super().settings(SCRATCH, changes)
        assert isinstance(found, Hyperparameters)
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

    def imitate(self, expert: Policy, cloning: Cloning, kept: Path, progress: bool) -> CloneReport:
        """Refused: it begins from screened policies.

        Raises:
            ValueError: always, with the remedy.
        """
        raise ValueError(
            "init = 'imitation': this learner cannot imitate; begin from 'scratch', or from a "
            "policy's file"
        )

    @property
    def _weights(self) -> Floats:
        return policy_of(self.model.policy)

    @property
    def act(self) -> Act:
        """The deterministic policy as it is now; it does nothing before one was found."""
        return functools.partial(policy.act, self._weights)

    def learn(self, until: int, watch: Watch) -> None:
        """Learn until there have been `until` steps; a roll-out that was begun is ended."""
        if self.steps < until and not len(self._contenders):
            self._race(self._screened(watch))
        while self.steps < until:
            turn_ends = self._begun + TRIAL if self._racing else until
            self._improve(min(turn_ends, until), turn_ends, watch)
            if self._racing and self.steps >= turn_ends:
                self._end_turn()

    def _screened(self, watch: Watch) -> Floats:
        """The random policy of each family that walks best, (families, SIZE)."""
        search = screen(SCREENING, self.training.seed)
        request = next(search)
        while True:
            watch.between()
            try:
                request = search.send(answered(request, self._world, self._worth))
            except StopIteration as end:
                found = end.value.values()
                break
        contenders, shares = [], []
        for policies in found:
            gaits = [self._gait_of(weights) for weights in policies]
            # Falls are mended later; the slowest whirlers walk surely, but only lean in the end.
            best = int(np.argmax([gait.share / gait.cot for gait in gaits]))
            contenders.append(policies[best])
            shares.append(gaits[best].share)
        walks = np.array(shares) >= min(LEAST_SHARE, max(shares))
        return np.array(contenders)[walks]

    def _race(self, contenders: Floats) -> None:
        """Begin with the first of some policies (n, SIZE)."""
        self._contenders, self._gaits = contenders.copy(), np.zeros((0, 3))
        self._begin(contenders[0], self._pacing.first_price)

    @property
    def _racing(self) -> bool:
        return len(self._gaits) < len(self._contenders) > 1

    def _end_turn(self) -> None:
        """Note how the last contender walks now; begin with the next, or go on with the best."""
        turn = len(self._gaits)
        self._contenders[turn] = self._weights
        self._gaits = np.vstack([self._gaits, self._gait_of(self._weights)])
        if self._racing:
            self._begin(self._contenders[turn + 1], self._pacing.first_price)
            return
        gaits = [CleanWalking(*map(float, gait)) for gait in self._gaits]
        best = max(range(len(gaits)), key=lambda k: _merit(gaits[k]))
        price = min(self._pacing.first_price, NEXT_MULTIPLE * gaits[best].cot)
        self._begin(self._contenders[best], price)

    def _begin(self, weights: Floats, price: float) -> None:
        """Begin to improve a policy, with a new critic and a first price."""
        steps = self._begun = self.steps
        self.model = self._new_model({})
        self.model.num_timesteps = steps
        self.model.policy.features_extractor.whiten(self._seen_by(weights))
        put_policy(self.model.policy, weights)
        self._paced = SelfPacedPrice(dataclasses.replace(self._pacing, first_price=price))

    def _seen_by(self, weights: Floats) -> NDArray[np.float32]:
        """What a policy observes on its walks, (N, 6)."""
        starts = draw_starts(self._world.params, SEEN_STARTS, (self.training.seed, 5))
        act = learned_policy(functools.partial(policy.act, weights))
        walks = Rollout(self.training.conditions, act, starts, SEEN_INTERVALS)
        return np.concatenate([interval.observations for interval in walks])

    def _improve(self, until: int, ends: int, watch: Watch) -> None:
        model = self.model
        model.set_logger(watch.log)
        critic_first = self._begun + CRITIC_FIRST * model.n_steps * model.n_envs
        actor = self.actor(model)
        rate, turn = float(self._arguments["learning_rate"]), (self._begun, ends)
        if self._racing:
            settle = Settle(actor, RACING_NOISE, (rate, rate), *turn)
        else:
            settle = Settle(actor, LAST_NOISE, (rate, LAST_RATE * rate), *turn)
        log = LogWalking(self.training.conditions.params, native_of(self._env))
        callbacks: list[BaseCallback] = [
            *(log, Watched(watch), self._paced, InMetres(self._env, self._paced)),
            *(Freeze(actor, critic_first), settle),
        ]
        model.learn(until - self.steps, callbacks, reset_num_timesteps=False)

    def _gait_of(self, weights: Floats) -> CleanWalking:
        """How a policy (SIZE,) walks, in the family of gaits in which it walks best."""
        starts = draw_starts(self._world.params, COMPARED_STARTS, (self.training.seed, 4))
        walks = self._world.walk(weights[None], starts, COMPARED)
        gaits = [self._worth.gait(walks, COMPARED, family) for family in families(walks)]
        return max(gaits, key=_merit, default=NO_WALK)

    def parts(self) -> PolicyParts:
        """The weights of the policy as it is now."""
        return PolicyParts({}, {"weights": self._weights})

    def state(self) -> dict[str, Any]:
        """The race, and all of the model that learns, between two roll-outs."""
        return {
            "contenders": self._contenders,
            "gaits": self._gaits,
            "begun": self._begun,
            "price": self._paced.state(),
            **state_of(self.model),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self._contenders, self._gaits = state["contenders"], state["gaits"]
        self._begun = int(state["begun"])
        restore(self.model, state)
        self._paced.restore(state["price"])


def _merit(gait: CleanWalking) -> float:
    return economy(gait.share, gait.cot)
