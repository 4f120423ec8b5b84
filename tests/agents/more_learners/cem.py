"""The cross-entropy method (Rubinstein, 1999) over linear policies: no gradient, no torch."""

import dataclasses
import functools

import numpy as np

from agents import learner
from agents.training import Settings
from agents.walking_figures import WalkingFigures

SIZE = 7  # six observations and a constant


@dataclasses.dataclass(frozen=True, kw_only=True)
class CemSettings(Settings):
    """Policies tried and kept per generation, control intervals per trial, and first spread."""

    n_timesteps: int = 4000
    population: int = 20
    elite: int = 5
    intervals: int = 50
    spread: float = 1.0


def act(weights, observations):
    """Actions (N,) of one policy (7,) or of N (N, 7) for observations (N, 6)."""
    return np.tanh(np.sum(observations * weights[..., :-1], axis=-1) + weights[..., -1])


class Learner(learner.Learner):
    """Draws policies around a mean, and moves the mean to the best of them."""

    def __init__(self, training, start=None):
        self._settings, self._conditions = training.settings, training.conditions
        self._envs = self._conditions.envs(self._settings.population, task=training.task)
        self._rng = np.random.default_rng(training.seed)
        self._mean = start.weights["mean"].copy() if start else np.zeros(SIZE)
        self._spread, self._steps = np.full(SIZE, self._settings.spread), 0

    @classmethod
    def settings(cls, init, changes=None):
        return CemSettings()

    @classmethod
    def load(cls, parts, conditions, task):
        return functools.partial(act, parts.weights["mean"])

    @property
    def steps(self):
        return self._steps

    @property
    def act(self):
        return functools.partial(act, self._mean)

    def learn(self, until, watch):
        figures = WalkingFigures(self._conditions.params)
        while self._steps < until:
            watch.between()
            drawn = self._mean + self._spread * self._rng.normal(
                size=(self._settings.population, SIZE)
            )
            best = drawn[np.argsort(-self._returns(drawn, figures, watch))[: self._settings.elite]]
            self._mean, self._spread = best.mean(axis=0), best.std(axis=0) + 0.01
            figures.record(watch.log)
            watch.log.dump(self._steps)

    def _returns(self, drawn, figures, watch):
        total, running = np.zeros(len(drawn)), np.ones(len(drawn), dtype=bool)
        observations, _ = self._envs.reset(seed=int(self._rng.integers(2**31)))
        for _ in range(self._settings.intervals):
            observations, rewards, fell, _, info = self._envs.step(
                act(drawn, observations)[:, None]
            )
            total += rewards * running
            running &= ~fell
            figures.add(info)
            self._steps += len(drawn)
            watch.advanced()
        return total

    def parts(self):
        return learner.PolicyParts({}, {"mean": self._mean})

    def state(self):
        generator = self._rng.bit_generator.state
        return {
            "mean": self._mean,
            "spread": self._spread,
            "steps": self._steps,
            "generator": generator,
        }

    def restore(self, state):
        self._mean, self._spread = state["mean"], state["spread"]
        self._steps, self._rng.bit_generator.state = state["steps"], state["generator"]
