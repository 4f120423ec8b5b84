"""Episodes as `gym.make` gives them, many at a time: what a policy saw, did and was paid."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from agents.policies import Policy
from rimless_gym import RimlessWheelVectorEnv
from trajopt.feedback.law import Floats


@dataclasses.dataclass(frozen=True)
class Episode:
    """One episode of T steps, by which the single environment repeats it bit for bit.

    Attributes:
        seed, options: of `reset`; options are None where it was given none.
        observations: the first one and those of all steps, float32 (T + 1, width).
        actions: float32 (T, 1).
        rewards: (T,).
        terminations, truncations: bool (T,); the last of one of them is True.
        infos: entries of `info` that were asked for, first those of the reset, (T + 1,) each.
    """

    seed: int
    options: dict[str, Any] | None
    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: Floats
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]
    infos: dict[str, NDArray[Any]]

    @property
    def total(self) -> float:
        """The return: the sum of all rewards (m)."""
        return float(self.rewards.sum())


def episodes(
    envs: RimlessWheelVectorEnv,
    policy: Policy,
    seed: int = 0,
    *,
    options: dict[str, Any] | None = None,
    keep: Sequence[str] = (),
    progress: str | None = None,
) -> list[Episode]:
    """One episode in each row, from its reset to its end.

    Args:
        envs: with a limit of steps.
        policy: see `agents.policies`; its actions are rounded to float32.
        seed: row i is reset with `seed + i`.
        options: of `reset`, which must suit a single environment too.
        keep: entries of `info` to keep.
        progress: title of a progress bar, or None for no bar.

    Raises:
        ValueError: the policy gives NaN or the wrong shape, or an option is not valid.
    """
    observations, info = envs.reset(seed=seed, options=options)
    running, lengths = np.ones(envs.num_envs, dtype=bool), np.zeros(envs.num_envs, dtype=int)
    seen, told, steps = [observations], [[info[name] for name in keep]], []
    with tqdm(
        total=envs.max_episode_steps, desc=progress, disable=not progress, leave=False
    ) as bar:
        while running.any():
            rows = running.nonzero()[0]
            actions = np.zeros((envs.num_envs, 1), dtype=np.float32)
            actions[rows, 0] = np.clip(policy(envs.states[rows], observations[rows]), -1.0, 1.0)
            observations, rewards, terminated, truncated, info = envs.step(actions)
            seen.append(observations)
            told.append([info[name] for name in keep])
            steps.append((actions, rewards, terminated, truncated))
            lengths[rows] += 1
            running &= ~(terminated | truncated)
            bar.update()
    done, paid, terminations, truncations = map(np.array, zip(*steps, strict=True))
    noted = dict(zip(keep, (np.array(column) for column in zip(*told, strict=True)), strict=True))
    states = np.array(seen)
    return [
        Episode(
            seed + row,
            options,
            states[: length + 1, row],
            done[:length, row],
            paid[:length, row],
            terminations[:length, row],
            truncations[:length, row],
            {name: column[: length + 1, row] for name, column in noted.items()},
        )
        for row, length in enumerate(lengths.tolist())
    ]
