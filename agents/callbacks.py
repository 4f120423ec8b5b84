"""Callbacks during learning: logs, evaluations, saved states, frozen parts, a progress bar."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from agents.evaluate import SHORT_PROTOCOL, Evaluation, Protocol, evaluate
from agents.imitate import actor_of
from agents.interrupts import StopRequest
from agents.policies import model_policy
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.envs.task import Task
from rimless_gym.params import WheelParams

_ENERGIES = ("copper", "friction", "drag", "collision", "shaft", "idle", "electrical")
_REWARDS = ("reward_distance", "reward_energy", "reward_end")
_SUMMED = (*_ENERGIES, *_REWARDS, "electrical_positive", "distance", "steps", "elapsed")

#: Seconds between two saved states of a training: as much is lost if it is killed.
SAVE_INTERVAL = 30.0

#: Fewest control intervals over which logged figures are summed.
LOG_INTERVALS = 2000


class LogWalking(BaseCallback):
    """Logs the noisy walking of training: return, CoT, speed, steps and energy terms.

    `walk/return` is the reward per 20 s of walking, `energy/*` are in watts.
    """

    def __init__(self, params: WheelParams) -> None:
        super().__init__()
        self._weight = params.weight
        self._clear()

    def _clear(self) -> None:
        self._sums = dict.fromkeys(_SUMMED, 0.0)
        self._intervals = 0
        self._falls = 0

    def _on_step(self) -> bool:
        sums = self._sums
        for info in self.locals["infos"]:
            for name in _SUMMED:
                sums[name] += info[name]
            self._falls += info["failure"] != 0
        self._intervals += len(self.locals["infos"])
        return True

    def _on_rollout_end(self) -> None:
        if self._intervals >= LOG_INTERVALS:
            self._record()

    def _on_training_end(self) -> None:
        if self._intervals:
            self._record()
        self.logger.dump(self.num_timesteps)

    def _record(self) -> None:
        sums, record = self._sums, self.logger.record
        rewards = sum(sums[name] for name in _REWARDS)
        record("walk/return", rewards / self._intervals * EPISODE_STEPS)
        record("walk/speed", sums["distance"] / sums["elapsed"])
        record("walk/steps_per_second", sums["steps"] / sums["elapsed"])
        record("walk/steps", sums["steps"])
        record("walk/falls", self._falls)
        if sums["distance"] > 0:
            energy = sums["electrical_positive"] + sums["idle"]
            record("walk/cot", energy / (self._weight * sums["distance"]))
        record("energy/electrical_positive", sums["electrical_positive"] / sums["elapsed"])
        for name in _ENERGIES:
            record(f"energy/{name}", sums[name] / sums["elapsed"])
        self._clear()


class KeepBest(BaseCallback):
    """Evaluates the deterministic policy at intervals and passes each new best one to `keep`.

    Args:
        params: the machine.
        task: whose reward the default score is.
        every: time steps from one evaluation to the next.
        score: larger is better; default `Evaluation.objective`, the reward per second.
        protocol: of the evaluations.

    Attributes:
        keep: called with each evaluation that beats all earlier ones, and its score.
        best: the best score so far.
        due: time steps at which the next evaluation is due; None: at the start.
        history: (time steps, evaluation) of each.
    """

    def __init__(
        self,
        params: WheelParams,
        task: Task,
        every: int,
        score: Callable[[Evaluation], float] | None = None,
        protocol: Protocol = SHORT_PROTOCOL,
    ) -> None:
        super().__init__()
        self._params, self._task, self._every = params, task, every
        self._score = score or (lambda evaluation: evaluation.objective)
        self._protocol = protocol
        self.keep: Callable[[Evaluation, float], object] = lambda evaluation, score: None
        self.best = -math.inf
        self.due: int | None = None
        self.history: list[tuple[int, Evaluation]] = []

    def _on_rollout_start(self) -> None:
        if self.due is None or self.num_timesteps >= self.due:
            self._evaluate()

    def _on_training_end(self) -> None:
        self._evaluate()

    def _on_step(self) -> bool:
        return True

    def _evaluate(self) -> None:
        self.due = self.num_timesteps + self._every
        result = evaluate(model_policy(self.model), self._params, self._protocol, task=self._task)
        self.history.append((self.num_timesteps, result))
        for name in ("walking_share", "speed", "cot", "cot_with_regeneration", "objective"):
            self.logger.record(f"eval/{name}", getattr(result, name))
        score = self._score(result)
        if score > self.best:
            self.best = score
            self.keep(result, score)
        self.logger.record("eval/best_score", self.best)


class SaveState(BaseCallback):
    """Saves the training between roll-outs: at intervals, after each evaluation, before stopping.

    Args:
        write: writes its state.
        stop: the request to stop, which ends the training by KeyboardInterrupt once it is saved.
        keeper: the callback that evaluates; it must come before this one.

    Attributes:
        kept: time steps in the state that was saved last.
    """

    def __init__(self, write: Callable[[], None], stop: StopRequest, keeper: KeepBest) -> None:
        super().__init__()
        self._write, self._stop, self._keeper = write, stop, keeper
        self._saved_at = -math.inf
        self._evaluations = 0
        self.kept = 0

    def _on_training_start(self) -> None:
        self.kept = self.num_timesteps

    def _on_rollout_start(self) -> None:
        evaluated = len(self._keeper.history) > self._evaluations
        if evaluated or self._stop.made or time.monotonic() - self._saved_at > SAVE_INTERVAL:
            self.save()
        if self._stop.made:
            raise KeyboardInterrupt

    def _on_step(self) -> bool:
        return True

    def save(self) -> None:
        """Write the state as it is now."""
        with self._stop.held_off():
            self._write()
            self.kept = self.model.num_timesteps
        self._saved_at, self._evaluations = time.monotonic(), len(self._keeper.history)


class Freeze(BaseCallback):
    """Keeps the actor as it is until the critic has learned what it is worth.

    Args:
        until: time steps before which the actor does not change.
        noise: whether the exploration noise of PPO stays as it is for good.
    """

    def __init__(self, until: int, noise: bool = True) -> None:
        super().__init__()
        self._until, self._noise = until, noise

    def _on_training_start(self) -> None:
        if self._noise and hasattr(self.model.policy, "log_std"):
            self.model.policy.log_std.requires_grad_(False)
        self._on_rollout_start()

    def _on_rollout_start(self) -> None:
        for weight in actor_of(self.model)[1]:
            weight.requires_grad_(self.num_timesteps >= self._until)

    def _on_step(self) -> bool:
        return True


class Progress(BaseCallback):
    """A progress bar with the time left."""

    def __init__(self, total: int, label: str, show: bool) -> None:
        super().__init__()
        self._settings: dict[str, Any] = {"total": total, "desc": label, "disable": not show}
        self._bar: Any = None

    def _on_training_start(self) -> None:
        initial = min(self.num_timesteps, self._settings["total"])
        self._bar = tqdm(initial=initial, unit="step", unit_scale=True, **self._settings)

    def _on_step(self) -> bool:
        self._bar.update(min(self.num_timesteps, self._bar.total) - self._bar.n)
        return True

    def close(self) -> None:
        """Leave the bar as it stands."""
        if self._bar is not None:
            self._bar.close()
