"""Starts from which an episode went wrong, to begin from again.

A policy that walks from nearly all starts sees few of those from which it falls or rests. So they
hardly count in an update. Drawn more often, they do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.pacing import FEWEST_STEPS
from agents.sb3.layers import layer_of
from agents.sb3.setting_off import SettingOff
from rimless_gym.checks import not_negative
from rimless_gym.equations import MODE_NAMES
from rimless_gym.kernel.stepping import MODE, STATE_SIZE
from trajopt.feedback.law import Floats

#: The most starts that are kept; the oldest are forgotten first.
MOST = 1024


class HardStarts(VecEnvWrapper):
    """Begins some episodes where another one has gone wrong.

    An episode went wrong if it ended before its time limit, or if the wheel got fewer than
    `FEWEST_STEPS` steps forward, less those backward, in its second half. Each such start is used
    once; it comes back if the episode that begins from it goes wrong, too.

    Args:
        venv: environments with a `SettingOff`, all of one machine. Commanded speeds are drawn anew.
        share: of the episodes that begin from such a start while any is kept, from 0 to 1.
        seed: of the draws.

    Attributes:
        share: as given; it may be changed at any time. At 0 all starts are forgotten.

    Raises:
        TypeError: the share is not a number, or there is no `SettingOff`.
        ValueError: it is out of range, or there are ranges of parameters.
    """

    def __init__(self, venv: VecEnv, share: float = 0.0, seed: int = 0) -> None:
        super().__init__(venv)
        self.share = not_negative("share", share)
        if share > 1.0:
            raise ValueError(f"share = {share:g}: a share of the episodes, must be at most 1")
        self._setting_off = layer_of(venv, SettingOff)
        if self.share and self._setting_off.native.env.ranges.bounds:
            raise ValueError(
                f"HardStarts: share = {share:g}: a start of one machine need not be one of "
                "another; give no ranges, or a share of 0"
            )
        self._rng = np.random.default_rng((seed, 7))
        self._found: list[Floats] = []
        self.forget()

    def forget(self) -> None:
        """Forget all starts; episodes under way are not judged."""
        n = self.num_envs
        self._found.clear()
        self._starts, self._steps = np.full((n, STATE_SIZE), np.nan), np.zeros(n)

    def reset(self) -> VecEnvObs:
        """The first observations."""
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        """What the environments give; some rows that end begin again from a hard start."""
        if self.share == 0.0:
            self.forget()
            return self.venv.step_wait()
        native, age = self._setting_off.native, self._setting_off.monitor.episode_lengths
        first = age == 0
        self._starts[first], self._steps[first] = native.env.states[first], 0
        limit = native.env.max_episode_steps
        late = np.zeros_like(first) if limit is None else age >= limit // 2
        observations, rewards, dones, infos = self.venv.step_wait()
        self._steps += late * native.last_info["steps"]
        ended = np.flatnonzero(dones).tolist()
        for i in ended:
            if self._went_wrong(i, infos[i]):
                self._found.append(self._starts[i].copy())
        del self._found[:-MOST]
        return self._begun(ended, observations), rewards, dones, infos

    def _went_wrong(self, i: int, info: dict[str, Any]) -> bool:
        """Whether the episode of row i, which has just ended with `info`, went wrong."""
        wrong = not info["TimeLimit.truncated"] or self._steps[i] < FEWEST_STEPS
        return bool(wrong and np.isfinite(self._starts[i]).all())

    def _begun(self, ended: list[int], observations: VecEnvObs) -> VecEnvObs:
        """Let some of the rows that ended begin from hard starts.

        Returns:
            The observations (N, 6 or 8), theirs replaced.
        """
        assert isinstance(observations, np.ndarray)
        chosen = [i for i in ended if self._rng.random() < self.share][: len(self._found)]
        if not chosen:
            return observations
        taken = [self._found.pop(self._rng.integers(len(self._found))) for _ in chosen]
        states, rows = np.array(taken), np.isin(np.arange(self.num_envs), chosen)
        options = {
            "state": states[:, :4].copy(),
            "mode": [MODE_NAMES[int(mode)] for mode in states[:, MODE]],
        }
        observations[rows] = self._setting_off.native.begin(rows, options)[rows]
        return observations

    def state(self) -> dict[str, Any]:
        """All that later starts depend on besides the environments."""
        return {
            "found": np.array(self._found).reshape(-1, STATE_SIZE),
            "starts": self._starts.copy(),
            "steps": self._steps.copy(),
            "generator": self._rng.bit_generator.state,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state."""
        self._found = list(state["found"])
        self._starts, self._steps = state["starts"].copy(), state["steps"].copy()
        self._rng.bit_generator.state = state["generator"]
