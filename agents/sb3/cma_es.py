"""CMA-ES on the last layer of a network: from a policy that walks down to the optimum near it.

Noise on actions is rectified: energy is drawn whichever way a current deviates, and none is fed
back. Noise of a hundredth of the voltage limit costs a clone a tenth of its energy, and the policy
that is best under noise is not the one that is best without. So the weights vary here, and every
policy walks without noise (Hansen, The CMA evolution strategy: a tutorial, arXiv:1604.00772). Only
the last layer varies, in the directions in which the actions of the policy's walks change most.
What is minimised is the cost of transport of walks from the gait, whatever their speed unless one
is commanded. Falls, from ordinary starts too, count by `agents.reward_weight.economy`. With a
`return_weight` the start-up counts, too. Where machines and disturbances are drawn, all
policies of a generation walk with the same ones, each start with its own. Where speeds are
commanded, each start has its own command for the whole walk, a walk costs more if its speed is
another, and the cost is the geometric mean over commands.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from agents.imitation import LabelledWalks, walk
from agents.learner import (
    LAST,
    NO_CHANGES,
    Callback,
    DoesNotWalkError,
    LearnerSettings,
    PolicyParts,
    Training,
)
from agents.outcomes import WALKS, WindowTotals, outcomes
from agents.reward_weight import economy
from agents.rollout import Rollout, draw_starts, learned_policy
from agents.sb3.hyperparameters import Hyperparameters
from agents.sb3.learner import FineTuner
from rimless_gym.checks import extra, not_negative
from rimless_gym.envs.layout import commanded_speeds
from rimless_gym.envs.task import TERM_NAMES
from rimless_gym.hybrid import OK
from rimless_gym.kernel.stepping import FOOT
from trajopt.feedback.law import Floats

with extra("learn"):
    import cma

#: Control intervals of a training, and after how many the search begins anew from where it is, in
#: the principal components of what the policy sees there.
TIMESTEPS, ANEW = 100_000_000, 100_000_000

#: Policies of a generation.
POPULATION = 16

#: The last layer varies in the principal components of what it sees, down to this share of the
#: first one's variance.
LEAST_VARIANCE = 1e-4

#: Standard deviation of the first generation in each of them: the root mean square of the change of
#: an action, in voltage limits. With 0.003, a generation costs more than any of its policies gains.
SPREAD = 0.0006

#: Starts of each policy: on the gait, from which the cost is measured, and at most so many from
#: which the policy so far falls or stands still, both chosen anew after so many generations; and
#: ordinary ones, new in each.
GAIT_STARTS, HARD_STARTS, ORDINARY_STARTS, RENEWED = 8, 16, 32, 20

#: Starts on the gait where each has a machine or a command of its own. With commands, there is one
#: in each of as many equal parts of the states that are shown, sorted by command.
VARIED_STARTS = 48

#: A walk that is off its commanded speed by this share counts as twice as expensive. With 0.02,
#: policies keep the command at the expense of the cost.
OFF_COMMAND = 0.06

#: Exponent of the share of starts in the score. By the reward of an episode, a fall in a hundred
#: costs an efficient gait about as much as 12 % of its energy. With 30 the cost comes down as far,
#: and fewer starts are lost.
EXPONENT = 30

#: The hyperparameter by which the returns of walks from ordinary starts count (1/m): their mean,
#: times this, is added to the logarithm of the score. With 1, a centimetre weighs as much as 1 % of
#: the energy; in the reward of an episode, 3 mm do.
RETURN_WEIGHT = "return_weight"

#: Seconds of a walk, and those at its end over which it is measured.
DURATION, WINDOW = 7.0, 4.0

#: Ordinary starts, and seconds of their walks, that show a policy's gait and its falls, and how
#: many observations of the first policy give the principal components.
SHOWN_STARTS, SHOWN, OBSERVED = 512, 6.0, 40_000

#: Within so long at their end (s), a wheel that walks stands on several feet.
STANDING = 2.0

#: Of what is random: the walks that are shown, the search, the walks that are scored, and the
#: commands of those from ordinary starts.
_SHOWN, _SEARCH, _SCORED, _COMMANDS = 2, 3, 4, 5


class CmaEs(FineTuner):
    """Evolves the last layer of a policy as PPO has it: of a clone, or of a policy of PPO."""

    # the search's mean: the periodic evaluations, of few starts, tell good policies no better. But
    # where gaits are only just stable, as after evolution, `BEST` is the one to keep
    name, timesteps, recommended = "cma_es", TIMESTEPS, LAST

    def __init__(self, training: Training, start: PolicyParts | None = None) -> None:
        super().__init__(training, start)
        self._search: LastLayer | None = None
        self._scores: list[Floats] = []

    @classmethod
    def settings(cls, init: str, changes: Mapping[str, Any] = NO_CHANGES) -> LearnerSettings:
        """Those of every `FineTuner`, and `RETURN_WEIGHT`, which is 0 unless it is given."""
        others = {name: value for name, value in changes.items() if name != RETURN_WEIGHT}
        settings = super().settings(init, others)
        if RETURN_WEIGHT not in changes:
            return settings
        assert isinstance(settings, Hyperparameters)
        weight = not_negative(RETURN_WEIGHT, changes[RETURN_WEIGHT])
        return dataclasses.replace(settings, entry={**settings.entry, RETURN_WEIGHT: weight})

    def learn(self, until: int, callback: Callback) -> None:
        """Evolve until there have been `until` steps; a generation that was begun is ended.

        Raises:
            DoesNotWalkError: no policy near the first one walks, or it falls from all starts.
        """
        search = self._begun()
        while self.steps < until:
            callback.on_iteration()
            scores = search.scores()
            if not self._scores and not scores.any():
                raise DoesNotWalkError(
                    f"init = {self.training.init!r}: no policy near it walks; begin from one that "
                    "walks"
                )
            self._scores.append(scores)
            search.tell(scores)
            self._put(search.mean)
            self.model.num_timesteps += search.intervals
            callback.log.record("cma_es/score", float(np.median(scores)))
            callback.log.record("cma_es/spread", search.spread)
            callback.on_step()
            callback.log.dump(self.steps)

    def _begun(self) -> LastLayer:
        """The search, at the generation to which its scores belong."""
        if self._search is None:
            self._search = LastLayer(self.training, self.model)
            for scores in self._scores:
                self._search.tell(scores)
            self._put(self._search.mean)
        return self._search

    def _put(self, layer: Floats) -> None:
        """Give the policy a last layer."""
        net = self.model.policy.action_net
        with torch.no_grad():
            net.weight[0] = torch.from_numpy(layer[:-1])
            net.bias[0] = layer[-1]

    def state(self) -> dict[str, Any]:
        """The first policy, and the scores so far, which bring the search to the same place."""
        state = super().state()
        if self._search is not None:
            state["weights"]["action_net.weight"][0] = self._search.first[:-1]
            state["weights"]["action_net.bias"][0] = self._search.first[-1]
        return {**state, "scores": self._scores}

    def restore(self, state: dict[str, Any]) -> None:
        """Begin the search with the first policy again, and send it the scores."""
        super().restore(state)
        self._scores = list(state["scores"])
        self._begun()


class LastLayer:
    """The search for a last layer: weights of H hidden features and a bias, (H + 1,).

    Attributes:
        first: the first policy's.
        intervals: of control, in which a generation walks.

    Raises:
        DoesNotWalkError: the first policy falls from all starts.
    """

    def __init__(self, training: Training, model: Any) -> None:
        self._conditions, self._task = training.conditions, training.task
        self._seed, written = training.seed, training.settings.written
        self._return_weight: float = written.get(RETURN_WEIGHT, 0.0)
        varied = self._conditions.commanded or self._conditions.ranges.bounds
        self._n_gait_starts = VARIED_STARTS if varied else GAIT_STARTS
        net, self._hidden = model.policy.action_net, model.policy.mlp_extractor.forward_actor
        self.first = np.append(net.weight[0].detach().numpy(), net.bias.detach().numpy())
        self._generation, period = 0, self._conditions.control.period
        self._lasting, self._window = round(DURATION / period), round(WINDOW / period)
        self._rng = np.random.default_rng((self._seed, _SEARCH))
        shown = self._show(self.first)
        if not self._choose(shown):
            raise DoesNotWalkError(
                f"init = {training.init!r}: falls within {SHOWN / 2:g} s from all or "
                f"nearly all of {SHOWN_STARTS} starts; begin from a policy that walks"
            )
        self._begin(self.first, shown)
        self._drawn = np.array(self._strategy.ask())

    def _begin(self, layer: Floats, shown: LabelledWalks) -> None:
        """Search about a layer, in the principal components of what is seen on its walks."""
        self._center, self._searched = layer, 0
        some = self._rng.integers(len(shown.observations), size=OBSERVED)
        features = self._features(shown.observations[some]).astype(np.float64)
        values, vectors = np.linalg.eigh(features.T @ features / len(features))
        large = values > LEAST_VARIANCE * values[-1]
        self._basis = vectors[:, large] / np.sqrt(values[large])
        options = {
            "popsize": POPULATION,
            "randn": lambda *shape: self._rng.standard_normal(shape),
            "seed": np.nan,  # numpy's global generator stays as it is
            "verbose": -9,
        }
        self._strategy = cma.CMAEvolutionStrategy(np.zeros(large.sum()), SPREAD, options)

    def _show(self, layer: Floats) -> LabelledWalks:
        """How a policy walks from ordinary starts."""
        period, params = self._conditions.control.period, self._conditions.params
        policy = learned_policy(lambda seen: self._features(seen) @ layer)
        starts = draw_starts(params, SHOWN_STARTS, (self._seed, _SHOWN, self._generation))
        first = self._first(_SHOWN)
        return walk(self._conditions, policy, starts, round(SHOWN / period), first, SHOWN)

    def _first(self, kind: int) -> int:
        """The seed of this generation's first walk, of the kind `_SHOWN` or `_SCORED`.

        The next walks have the next seeds.
        """
        sequence = np.random.SeedSequence((self._seed, kind, self._generation))
        return int(sequence.generate_state(1)[0])

    def _choose(self, shown: LabelledWalks) -> bool:
        """Choose starts on the gait that is shown, and hard ones; False: nothing walks."""
        period = self._conditions.control.period
        gait = shown.take(np.flatnonzero(shown.when >= round(SHOWN / 2 / period)))
        if len(gait.when) < self._n_gait_starts:
            return False
        late = shown.when >= round((SHOWN - STANDING) / period)
        feet = np.stack([shown.which, shown.states[:, FOOT].astype(np.int64)], axis=1)[late]
        stood_on = np.bincount(np.unique(feet, axis=0)[:, 0], minlength=SHOWN_STARTS)
        fallen = np.bincount(shown.which, minlength=SHOWN_STARTS) < round(SHOWN / period)
        lost = fallen | (stood_on < 2)
        n, hard = self._n_gait_starts, np.flatnonzero(lost)[:HARD_STARTS]
        first, some = shown.take(np.flatnonzero(shown.when == 0)[hard]), self._gait_starts(gait)
        self._starts = np.concatenate([some.states, first.states])
        self._seeds = self._first(_SHOWN) + np.concatenate([some.which, hard])
        self._observations = np.concatenate([some.observations, first.observations])
        usual = n + ORDINARY_STARTS
        shares = np.full(usual + len(hard), 1.0 / usual)
        shares[n : n + len(hard)] = lost.mean() / max(1, len(hard))
        self._shares = shares / shares.sum()
        self.intervals = POPULATION * len(shares) * self._lasting
        return True

    def _gait_starts(self, gait: LabelledWalks) -> LabelledWalks:
        """Starts on the gait; one in each of equal parts of the commands, if there are any."""
        if not self._conditions.commanded:
            return gait.take(self._rng.integers(len(gait.when), size=self._n_gait_starts))
        by_command = np.argsort(commanded_speeds(gait.observations), kind="stable")
        parts = np.array_split(by_command, self._n_gait_starts)
        return gait.take(np.array([self._rng.choice(part) for part in parts]))

    def _features(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """The hidden features and a one, (N, H + 1)."""
        with torch.no_grad():
            hidden = self._hidden(torch.from_numpy(observations)).numpy()
        return np.concatenate([hidden, np.ones((len(hidden), 1), np.float32)], axis=1)

    @property
    def mean(self) -> Floats:
        """The last layer to which the search has come, (H + 1,)."""
        return self._center + self._basis @ self._strategy.mean

    @property
    def spread(self) -> float:
        """The standard deviation of a generation, in units of that of the first."""
        return float(self._strategy.sigma) / SPREAD

    def tell(self, scores: Floats) -> None:
        """Go on to the next generation, with the scores (POPULATION,) of this one."""
        self._strategy.tell(list(self._drawn), list(-scores))
        self._generation, self._searched = self._generation + 1, self._searched + self.intervals
        if self._generation % RENEWED == 0:
            shown = self._show(self.mean)
            self._choose(shown)
            if self._searched >= ANEW:
                self._begin(self.mean, shown)
        self._drawn = np.array(self._strategy.ask())

    def scores(self) -> Floats:
        """Of each policy of this generation, (POPULATION,); 0 where nothing walks."""
        layers = (self._center + self._drawn @ self._basis.T).astype(np.float32)
        params = self._conditions.params
        ordinary = draw_starts(params, ORDINARY_STARTS, (self._seed, _SCORED, self._generation))
        starts = np.tile(np.concatenate([self._starts, ordinary]), (POPULATION, 1))
        whose = np.repeat(np.arange(POPULATION), len(self._shares))
        others = self._first(_SCORED) + np.arange(ORDINARY_STARTS)
        seeds = np.tile(np.append(self._seeds, others), POPULATION).tolist()
        commands = self._commands()

        def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
            own = layers[whose[rollout.running]]
            return np.asarray(np.einsum("nh,nh->n", self._features(observations), own))

        walked = self._conditions, policy, starts, self._lasting, seeds, self._task
        rollout = Rollout(*walked, command=commands)
        window, fallen = WindowTotals(rollout.machines), np.zeros(len(starts), dtype=bool)
        steps, returns = np.zeros(len(starts)), np.zeros(len(starts))
        for k, interval in enumerate(rollout):
            returns[interval.running] += sum(interval.info[name] for name in TERM_NAMES)
            fallen[interval.running] = interval.info["failure"] != OK
            if k >= self._lasting - self._window:
                window.add(interval)
                steps[interval.running] += interval.info["steps"]
        walking = np.array([each == WALKS for each in outcomes(fallen, steps > 0, window)])
        steady = walking & (np.arange(len(starts)) % len(self._shares) < self._n_gait_starts)
        any_steady = steady.reshape(POPULATION, -1).any(axis=1)
        shares = (any_steady * (walking.reshape(POPULATION, -1) @ self._shares)).tolist()
        of_policy = [steady & (whose == k) for k in range(POPULATION)]
        if commands is None:
            cots = [window.total(some, params)[1].cost_of_transport(params) for some in of_policy]
        else:
            costs = penalised_costs(commands, window, steady)
            cots = [geometric_mean(costs[some]) for some in of_policy]
        scores = np.array([economy(*each, EXPONENT) for each in zip(shares, cots, strict=True)])
        returned = returns.reshape(POPULATION, -1)[:, -ORDINARY_STARTS:].mean(axis=1)
        scores *= np.exp(self._return_weight * returned)
        return np.nan_to_num(scores)  # NaN: the hub went nowhere

    def _commands(self) -> Floats | None:
        """The speeds (m/s) that this generation's walks are commanded, of all its policies."""
        if self._conditions.control.speeds is None:
            return None
        rng = np.random.default_rng((self._seed, _COMMANDS, self._generation))
        ordinary = rng.uniform(*self._conditions.control.speeds, size=ORDINARY_STARTS)
        return np.tile(np.append(commanded_speeds(self._observations), ordinary), POPULATION)


def penalised_costs(commands: Floats, window: WindowTotals, some: NDArray[np.bool_]) -> Floats:
    """Costs of transport of some walks, more where a speed is not the one commanded.

    Args:
        commands: speeds (m/s), (N,).
        window: the walks, N of them.
        some: of the walks, (N,).

    Returns:
        (N,); NaN for the others.
    """
    costs, walks = np.full(len(commands), np.nan), window.ledgers()
    for i in np.flatnonzero(some).tolist():
        off = walks[i].distance / walks[i].time / commands[i] - 1.0
        costs[i] = walks[i].cost_of_transport(window.machines[i]) * (1.0 + (off / OFF_COMMAND) ** 2)
    return costs


def geometric_mean(costs: Floats) -> float:
    """Of costs (N,); infinite without any."""
    return float(np.exp(np.log(costs).mean())) if len(costs) else np.inf
