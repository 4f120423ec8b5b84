"""PPO of stable-baselines3 that goes on from screened random policies.

No small change leads from leaning to the efficient gaits, in which the pendulum makes a revolution
per step: PPO that begins with an untrained network never finds them. So thousands of random
policies are screened first, as evolution does it (`agents.evolution.search`). PPO then improves
some of every family of gaits in a short trial and the best of them in two longer rounds, and goes
on with the best of all. They are linear in the products of `agents.evolution.walks`, and their
critics are new in each round.

The screening takes about 50 million control intervals, which do not count as time steps.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from agents import learner
from agents.conditions import Conditions, require_usual
from agents.evolution.search import EvolutionSettings, answered, screen
from agents.evolution.walks import (
    SIZE,
    Duration,
    PolicySimulator,
    WalkReward,
    act,
    families,
    features,
)
from agents.learner import LAST, NO_CHANGES, SCRATCH, LearnerSettings, PolicyParts, Training
from agents.reward_weight import NO_WALK, CleanWalking, economy
from agents.rollout import Act, Rollout, draw_starts, learned_policy
from agents.sb3.hyperparameters import Hyperparameters
from agents.sb3.learner import Actor, Sb3Learner, model_state, restore_model
from agents.sb3.reward_weight import AdaptiveRewardWeight, WeightSchedule
from agents.sb3.wrappers import ScaledReward, StartUpPhase, begin_out_of_step, wrapped
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

#: Candidates of one family that may go on to the next round.
OF_A_FAMILY = 2

#: A direction in which the products hardly vary is stretched as though its mean square were larger
#: by this. docs/learning.md has trials with more and with less.
FLOOR = 0.003

#: Advantages further from the median than so many spreads count as though they were at that limit.
LIMIT = 10.0

#: The percentage of a normal distribution that lies within one standard deviation.
WITHIN_SPREAD = 68.27


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
            self._race = Tournament(weights[None], np.zeros(1, dtype=np.int64), len(ROUNDS) - 1)
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

    def learn(self, until: int, callback: learner.Callback) -> None:
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

    def _screened(self, callback: learner.Callback) -> Tournament:
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

    def _improve(self, until: int, ends: int, callback: learner.Callback) -> None:
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


class PpoRound(NamedTuple):
    """How PPO improves each candidate, for some time, before they are compared.

    Attributes:
        steps: time steps; None: all that are left.
        critic_first: roll-outs at the beginning in which only the critic learns. A critic that has
            only begun to learn spoils a good policy within a minute.
        noise: standard deviations at first and in the end, in units of the limit. To leave costly
            gaits takes more noise than efficient ones stand; and what is best under noise is not
            what is best without, so noise that stays stops the descent.
        last_rate: to what share of itself the learning rate falls.
        finalists: candidates that go on to the next round, at most `OF_A_FAMILY` of each family.
    """

    steps: int | None
    critic_first: int
    noise: tuple[float, float]
    last_rate: float
    finalists: int


#: A trial of all candidates, two rounds of the best, and the best of all to the end.
ROUNDS = (
    PpoRound(1_000_000, 4, (0.1, 0.1), 1.0, finalists=5),
    PpoRound(2_000_000, 8, (0.1, 0.1), 1.0, finalists=2),
    PpoRound(5_000_000, 8, (0.1, 0.06), 1.0, finalists=1),
    PpoRound(None, 12, (0.06, 0.02), 0.2, finalists=0),
)


def score(gait: CleanWalking) -> float:
    """Distance per energy, times the share of starts that walk.

    A share counts for less than in `agents.reward_weight.economy`: falls and rests are mended
    later, and the slowest gaits, which only lean in the end, walk from nearly all starts.
    """
    return gait.share / gait.cot


@dataclasses.dataclass
class Tournament:
    """Candidates that are improved one after the other, round after round, until one is left.

    Attributes:
        candidates: weights of the round's policies, (n, size). Each is replaced by what it has
            become.
        families: of their gaits, (n,).
        round: index of the round.
        gaits: of the candidates that have been improved in this round.
    """

    candidates: Floats
    families: NDArray[np.int64]
    round: int = 0
    gaits: list[CleanWalking] = dataclasses.field(default_factory=list)

    @property
    def rules(self) -> PpoRound:
        """How policies are improved in this round."""
        return ROUNDS[self.round]

    @property
    def decided(self) -> bool:
        """Whether one candidate is left, which learns to the end."""
        return self.rules.steps is None

    @property
    def candidate(self) -> Floats:
        """Weights of the policy that is improved now, (size,)."""
        return self.candidates[len(self.gaits)]

    def advance(self, weights: Floats, gait: CleanWalking) -> None:
        """Note what the policy has become and how it walks; go on to the next one."""
        self.candidates[len(self.gaits)] = weights
        self.gaits.append(gait)
        if len(self.gaits) < len(self.candidates):
            return
        best: list[int] = []
        for k in sorted(range(len(self.gaits)), key=lambda k: -score(self.gaits[k])):
            if (self.families[best] == self.families[k]).sum() < OF_A_FAMILY:
                best.append(k)
        best = best[: self.rules.finalists]
        self.candidates, self.families = self.candidates[best], self.families[best]
        self.round, self.gaits = self.round + 1, []

    @classmethod
    def read(cls, state: Mapping[str, Any]) -> Tournament:
        """The race of which `dataclasses.asdict` made this."""
        gaits = [CleanWalking(*gait) for gait in state["gaits"]]
        return cls(**{**state, "gaits": gaits})


class Products(BaseFeaturesExtractor):
    """The products, mixed so that gradients are natural ones.

    Along a gait the products are nearly dependent: in some directions of their space they vary
    a hundred times as much as in others, and a gradient sees only the first. `whiten` mixes them so
    that all directions count alike. For a linear policy with constant noise, gradients then are
    the natural ones (Kakade, A natural policy gradient, 2001).
    """

    mixing: torch.Tensor

    def __init__(self, space: Any) -> None:
        super().__init__(space, SIZE)
        self.register_buffer("mixing", torch.eye(SIZE))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """The mixed products (N, SIZE) of observations (N, 6)."""
        return _products(observations) @ self.mixing

    def whiten(self, observations: NDArray[np.float32]) -> None:
        """Mix the products so that they vary alike over some observations (N, 6)."""
        products = _products(torch.from_numpy(observations)).numpy().astype(np.float64)
        variances, directions = np.linalg.eigh(products.T @ products / len(products))
        mixing = (directions / np.sqrt(variances + FLOOR)) @ directions.T
        self.mixing.copy_(torch.from_numpy(mixing))


def _products(observations: torch.Tensor) -> torch.Tensor:
    constant, *others = features(*observations.unbind(1))
    return torch.stack([torch.full_like(others[0], constant), *others], dim=1)


def put_policy(network: Any, weights: Floats) -> None:
    """Let a stable-baselines3 policy with `Products` act by weights (SIZE,) of the products."""
    mixing = network.features_extractor.mixing.double()
    with torch.no_grad():
        network.action_net.bias.zero_()
        network.action_net.weight[0] = torch.linalg.solve(mixing, torch.from_numpy(weights))


def policy_of(network: Any) -> Floats:
    """The weights (SIZE,) of the products by which a stable-baselines3 policy acts."""
    layer, mixing = network.action_net, network.features_extractor.mixing
    weights = mixing.numpy() @ layer.weight.detach().numpy()[0].astype(np.float64)
    weights[0] += layer.bias.item()  # the constant product comes first
    return np.asarray(weights)


class NormalizeByPhase(BaseCallback):
    """Gives advantages of start-up, of walking and of stalled wheels mean 0 and spread 1 each.

    Otherwise those of the gait, which hardly vary, are lost among the others. A wheel has stalled
    if it has started up but takes no step forward in a roll-out, which should last longer than a
    step. A time step counts by its first control interval. For on-policy algorithms that do not
    normalise advantages themselves.
    """

    def __init__(self, env: StartUpPhase) -> None:
        super().__init__()
        self._env = env
        self._starting: list[NDArray[np.bool_]] = []
        self._steps_before = env.steps

    def _on_rollout_start(self) -> None:
        self._starting, self._steps_before = [self._env.starting], self._env.steps

    def _on_step(self) -> bool:
        self._starting.append(self._env.starting)
        return True

    def _on_rollout_end(self) -> None:
        buffer: Any = self.locals["rollout_buffer"]
        starting = np.array(self._starting[: len(buffer.advantages)])
        walks = self._env.steps > self._steps_before
        for samples in (starting, ~starting & walks, ~starting & ~walks):
            advantages = buffer.advantages[samples]
            if len(advantages) > 1:
                buffer.advantages[samples] = normalized(advantages)


def normalized(advantages: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Advantages (N,) with mean 0 and standard deviation 1, in which rare ones do not hide others.

    The spread is measured by the usual ones, and what is beyond `LIMIT` spreads is clipped.
    """
    centred = advantages - np.median(advantages)
    limit = LIMIT * np.percentile(np.abs(centred), WITHIN_SPREAD)
    if limit > 0.0:
        centred = np.clip(centred, -limit, limit)
    return (centred - centred.mean()) / (centred.std() + 1e-8)


class Improve(BaseCallback):
    """Improves a candidate: what changes between two roll-outs of a round.

    Rewards are divided by the weight of distance, so that they keep their size while it falls. The
    actor stays as it is until the critic has learned what it is worth. Then the noise falls
    geometrically and the learning rate linearly, until the end of the round.

    Args:
        actor, rules, rate: of the model that learns, of the round, and of learning at first.
        steps: time steps at which the round begins, its actor begins to learn, and it ends.
        env, adaptive: what scales the rewards, and the weight of distance.
    """

    def __init__(
        self,
        actor: Actor,
        rules: PpoRound,
        rate: float,
        steps: tuple[int, int, int],
        env: ScaledReward,
        adaptive: AdaptiveRewardWeight,
    ) -> None:
        super().__init__()
        self._actor, self._rules, self._rate = actor, rules, rate
        self._begin, self._actor_begins, self._end = steps
        self._env, self._scale, self._adaptive = env, env.scale, adaptive

    def _on_rollout_start(self) -> None:
        assert self._adaptive.weight is not None
        self._env.scale = self._scale / self._adaptive.weight
        self._actor.freeze(self.num_timesteps < self._actor_begins)
        lasting = max(1, self._end - self._begin)
        share = min(1.0, (self.num_timesteps - self._begin) / lasting)
        loud, quiet = self._rules.noise
        self._actor.set_noise((1.0 - share) * math.log(loud) + share * math.log(quiet))
        rate = (1.0 - share) * self._rate + share * self._rules.last_rate * self._rate
        self.model.lr_schedule = lambda _: rate

    def _on_step(self) -> bool:
        return True

    def _on_training_end(self) -> None:
        self._env.scale = self._scale


class KeepBest(BaseCallback):
    """Checks the policy now and then, between two roll-outs, and keeps the weights of the best.

    From update to update a policy walks from a few more or a few less starts, and costs a little
    more or less. So the last one is rarely the best. It logs `checks/share` and `checks/cot`.

    Attributes:
        weights: of the policy with the greatest `economy` so far; None before any has walked.
    """

    def __init__(self, gait_of: Callable[[Floats], CleanWalking], every: int) -> None:
        super().__init__()
        self.weights: Floats | None = None
        self._gait_of, self._every = gait_of, every
        self._economy, self._due = 0.0, 0

    def _on_rollout_start(self) -> None:
        if self.num_timesteps < self._due:
            return
        self._due = self.num_timesteps + self._every
        weights = policy_of(self.model.policy)
        gait = self._gait_of(weights)
        self.logger.record("checks/share", gait.share)
        if np.isfinite(gait.cot):
            self.logger.record("checks/cot", gait.cot)
        reached = economy(gait.share, gait.cot)
        if reached > self._economy:
            self._economy, self.weights = reached, weights

    def _on_step(self) -> bool:
        return True

    def state(self) -> dict[str, Any]:
        """What it keeps, and when the next check is due."""
        return {"weights": self.weights, "economy": self._economy, "due": self._due}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self.weights, self._economy, self._due = state["weights"], state["economy"], state["due"]
