"""Evolution of smooth policies on the compiled simulator, from nothing: no gait, no demonstration.

See `agents.evolution.campaign` for the search and `agents.evolution.policy` for what evolves. It
takes 600 million control intervals, which is five minutes of two cores or less.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from agents import learner
from agents.conditions import Conditions, require_usual
from agents.evolution import policy
from agents.evolution.answering import answered
from agents.evolution.asking import Answer, Request
from agents.evolution.campaign import campaign
from agents.evolution.settings import EvolutionSettings
from agents.evolution.walks import World
from agents.evolution.worth import Worth
from agents.learner import NO_CHANGES, PolicyParts, Watch, require_known
from agents.pacing import CleanWalking
from agents.policies import Act
from agents.training import Settings, Training
from rimless_gym.envs.task import Task
from trajopt.feedback.law import Floats


class Learner(learner.Learner):
    """Screens random policies, and evolves the best of every family of gaits.

    Raises:
        TypeError: the training's settings are not `EvolutionSettings`.
        ValueError: there are ranges or disturbances, a commanded speed, or another control period.
    """

    def __init__(self, training: Training, start: PolicyParts | None = None) -> None:
        conditions, settings = training.conditions, training.settings
        if not isinstance(settings, EvolutionSettings):
            raise TypeError(f"settings = {settings!r}: must be EvolutionSettings")
        require_usual("evolution", conditions)
        self._world = World(conditions.params)
        self._worth = Worth(conditions.params, training.task, settings.paid_speed)
        self._search = functools.partial(
            campaign, settings, training.seed, training.task.distance_weight
        )
        self._begin(None if start is None else start.weights["weights"].astype(np.float64))

    def _begin(self, start: Floats | None) -> None:
        self._start, self._steps = start, 0
        self._answers: list[Answer] = []
        self._campaign = self._search(start)
        self._request = next(self._campaign)

    @classmethod
    def settings(cls, init: str, changes: Mapping[str, Any] = NO_CHANGES) -> Settings:
        """The defaults, for every start."""
        require_known(changes, [field.name for field in dataclasses.fields(EvolutionSettings)])
        return EvolutionSettings(**changes)

    @classmethod
    def load(cls, parts: PolicyParts, conditions: Conditions, task: Task) -> Act:
        """The policy in `parts`."""
        weights = parts.weights["weights"].astype(np.float64)
        if weights.shape != (policy.SIZE,):
            raise ValueError(f"weights: have shape {weights.shape}, must be ({policy.SIZE},)")
        return functools.partial(policy.act, weights)

    @property
    def steps(self) -> int:
        """Control intervals so far, all wheels together."""
        return self._steps

    @property
    def act(self) -> Act:
        """The best policy so far; it does nothing before one walks."""
        return functools.partial(policy.act, self._request.best)

    def learn(self, until: int, watch: Watch) -> None:
        """Go on until there have been `until` steps, or some more."""
        while self._steps < until:
            watch.doing("" if self._steps else "screening random policies")
            watch.between()
            request = self._request
            answer = answered(request, self._world, self._worth)
            _log(watch, request, answer)
            self._send(answer)
            self._steps += len(request.weights) * request.starts * request.duration.intervals
            watch.advanced()
            watch.log.dump(self._steps)

    def _send(self, answer: Answer) -> None:
        self._answers.append(answer)
        self._request = self._campaign.send(answer)

    def parts(self) -> PolicyParts:
        """The weights of the best policy so far."""
        return PolicyParts({}, {"weights": self._request.best})

    def state(self) -> dict[str, Any]:
        """The answers so far, from which the campaign comes to the same place again."""
        groups = [answer.groups for answer in self._answers]
        return {
            "steps": self._steps,
            "start": np.empty(0) if self._start is None else self._start,
            "groups": np.concatenate([*groups, np.empty(0)]),
            "counts": np.array([len(each) for each in groups], dtype=np.int64),
            "sizes": np.array([answer.worth.shape[1] for answer in self._answers], dtype=np.int64),
            "worth": np.concatenate([*(a.worth.ravel() for a in self._answers), np.empty(0)]),
            "gaits": np.array([answer.gait for answer in self._answers]).reshape(-1, 3),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Send the answers of a state to a new campaign."""
        self._begin(state["start"] if len(state["start"]) else None)
        groups: Floats = state["groups"]
        worth: Floats = state["worth"]
        for count, size, gait in zip(state["counts"], state["sizes"], state["gaits"], strict=True):
            of, groups = groups[:count], groups[count:]
            earned, worth = worth[: count * size], worth[count * size :]
            self._send(Answer(of, earned.reshape(count, size), CleanWalking(*map(float, gait))))
        self._steps = int(state["steps"])


def _log(watch: Watch, request: Request, answer: Answer) -> None:
    log = watch.log
    log.record("evolution/price", request.price)
    if isinstance(request.among, int):
        log.record("evolution/worth", float(answer.worth[0].mean()))
        log.record("evolution/best_worth", float(answer.worth.max()))
        log.record("evolution/family", request.among)
    if len(request.weights) == 1 and answer.gait.share > 0.0:
        log.record("walk/share", answer.gait.share)
        log.record("walk/cot", answer.gait.cot)
        log.record("walk/speed", answer.gait.speed)
