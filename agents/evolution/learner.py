"""Evolution of smooth policies on the compiled simulator, from nothing: no gait, no demonstration.

See `agents.evolution.search` for the search and `agents.evolution.walks` for what evolves. It takes
600 million control intervals, about four minutes of one core.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from agents.conditions import Conditions, require_usual
from agents.evolution.search import Answer, EvolutionSettings, Request, answered, search
from agents.evolution.walks import SIZE, PolicySimulator, WalkReward, act
from agents.learner import Callback, Learner, PolicyParts, Training
from agents.reward_weight import CleanWalking
from agents.rollout import Act
from rimless_gym.envs.task import Task
from trajopt.feedback.law import Floats


class Evolution(Learner):
    """Screens random policies, and evolves the best of every family of gaits."""

    default_settings = EvolutionSettings()

    def __init__(self, training: Training, start: PolicyParts | None = None) -> None:
        conditions, settings = training.conditions, training.settings
        if not isinstance(settings, EvolutionSettings):
            raise TypeError(f"settings = {settings!r}: must be EvolutionSettings")
        require_usual("evolution", conditions)
        self._simulator = PolicySimulator(conditions.params)
        self._objective = WalkReward(conditions.params, training.task, settings.rewarded_speed)
        floor = training.task.distance_weight
        self._new_search = functools.partial(search, settings, training.seed, floor)
        self._begin(None if start is None else start.weights["weights"].astype(np.float64))

    def _begin(self, start: Floats | None) -> None:
        self._start, self.steps = start, 0
        self._answers: list[Answer] = []
        self._search = self._new_search(start)
        self._request = next(self._search)

    @classmethod
    def load(cls, parts: PolicyParts, conditions: Conditions, task: Task) -> Act:
        """The policy in `parts`."""
        weights = parts.weights["weights"].astype(np.float64)
        if weights.shape != (SIZE,):
            raise ValueError(f"weights: have shape {weights.shape}, must be ({SIZE},)")
        return functools.partial(act, weights)

    @property
    def act(self) -> Act:
        """The best policy so far; it does nothing before one walks."""
        return functools.partial(act, self._request.best)

    def learn(self, until: int, callback: Callback) -> None:
        """Go on until there have been `until` steps, or some more."""
        while self.steps < until:
            callback.on_phase("" if self.steps else "screening random policies")
            callback.on_iteration()
            request = self._request
            answer = answered(request, self._simulator, self._objective)
            _log(callback, request, answer)
            self._send(answer)
            self.steps += len(request.weights) * request.starts * request.duration.intervals
            callback.on_step()
            callback.log.dump(self.steps)

    def _send(self, answer: Answer) -> None:
        self._answers.append(answer)
        self._request = self._search.send(answer)

    def parts(self) -> PolicyParts:
        """The weights of the best policy so far."""
        return PolicyParts({}, {"weights": self._request.best})

    def state(self) -> dict[str, Any]:
        """The answers so far, from which the search comes to the same place again."""
        return {
            "steps": self.steps,
            "start": self._start,
            "answers": [tuple(answer) for answer in self._answers],
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Send the answers of a state to a new search."""
        self._begin(state["start"])
        for groups, scores, gait in state["answers"]:
            self._send(Answer(groups, scores, CleanWalking(*gait)))
        self.steps = int(state["steps"])


def _log(callback: Callback, request: Request, answer: Answer) -> None:
    log = callback.log
    log.record("evolution/distance_weight", request.distance_weight)
    if isinstance(request.groups, int):
        log.record("evolution/score", float(answer.scores[0].mean()))
        log.record("evolution/best_score", float(answer.scores.max()))
        log.record("evolution/family", request.groups)
    if len(request.weights) == 1 and answer.gait.share > 0.0:
        log.record("walk/share", answer.gait.share)
        log.record("walk/cot", answer.gait.cot)
        log.record("walk/speed", answer.gait.speed)
