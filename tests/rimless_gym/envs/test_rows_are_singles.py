"""Every row of the native vector environment is the single environment, to the last bit."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from rimless_gym.envs.batch import LEAST_ROWS
from tests.rimless_gym.envs.rows import DISABLED, ID, NEXT, ROUGH, SAME, SPEED_ID, make, swinging


def row_of(info: dict[str, Any], i: int) -> dict[str, Any]:
    """One row of a dense info."""
    return {name: values[i] for name, values in info.items() if not name.startswith(("_", "final"))}


class Singles:
    """Single environments side by side, which the tests reset as each autoreset mode does."""

    def __init__(self, n: int, seed: int, id: str, **settings: Any) -> None:
        self.envs = [gym.make(id, **settings) for _ in range(n)]
        self.ended = [False] * n
        self.ends = {"terminated": 0, "truncated": 0}
        self.first = [self.reset(i, seed=seed + i) for i in range(n)]

    def step(self, i: int, action: np.ndarray) -> tuple:
        seen, reward, terminated, truncated, _ = self.envs[i].step(action)
        self.ended[i] = terminated or truncated
        self.ends["terminated"] += terminated
        self.ends["truncated"] += truncated
        return seen, reward, terminated, truncated, self.envs[i].unwrapped.measurements

    def reset(self, i: int, **seed: int) -> tuple[np.ndarray, dict[str, Any]]:
        self.ended[i] = False
        return self.envs[i].reset(**seed)[0], self.envs[i].unwrapped.measurements


@pytest.mark.parametrize(
    ("id", "n", "settings"),
    [
        (ID, 1, {}),
        (ID, 3, ROUGH),
        (ID, 16, {}),
        (ID, 20, ROUGH),
        (ID, 5, {"control_period": 0.04}),
        (ID, 5, {"actions": "current"}),
        (SPEED_ID, 9, ROUGH),
        pytest.param(ID, 100, ROUGH, marks=pytest.mark.slow),
    ],
    ids=lambda value: "rough" if value == ROUGH else str(value),
)
@pytest.mark.parametrize("mode", [NEXT, SAME, DISABLED], ids=lambda mode: mode.value)
def test_every_row_is_the_single_environment_to_the_last_bit(
    mode: AutoresetMode, id: str, n: int, settings: dict
) -> None:
    steps, settings = 1200 // n if n < 5 else 200, settings | {"max_episode_steps": 120}
    envs, singles = make(n, mode, id, **settings), Singles(n, 11, id, **settings)
    seen, info = envs.reset(seed=11)
    assert np.array_equal(seen, [first for first, _ in singles.first])
    assert [row_of(info, i) for i in range(n)] == [first for _, first in singles.first]
    for actions in swinging(n, steps):
        if mode is DISABLED and any(singles.ended):
            mask = np.array(singles.ended)
            seen, info = envs.reset(options={"reset_mask": mask})
            for i in np.flatnonzero(mask):
                expected, begun = singles.reset(i)
                assert np.array_equal(seen[i], expected)
                assert row_of(info, i) == begun
        seen, rewards, terminated, truncated, info = envs.step(actions)
        for i in range(n):
            if singles.ended[i]:  # left over from the last step: mode is NEXT
                expected, begun = singles.reset(i)
                assert np.array_equal(seen[i], expected)
                assert row_of(info, i) == begun
                assert (rewards[i], terminated[i], truncated[i]) == (0.0, False, False)
                continue
            expected, *others, one = singles.step(i, actions[i])
            assert [rewards[i], terminated[i], truncated[i]] == others
            transition = info
            if mode is SAME and singles.ended[i]:
                assert info["_final_obs"][i]
                assert info["_final_info"][i]
                assert np.array_equal(info["final_obs"][i], expected)
                transition = info["final_info"]
                expected, begun = singles.reset(i)
                assert info["mode"][i] == begun["mode"]
            elif mode is SAME and "_final_obs" in info:
                assert not info["_final_obs"][i]
                assert not info["_final_info"][i]
            assert np.array_equal(seen[i], expected)
            assert row_of(transition, i) == one
    assert singles.ends["truncated"] > 0
    assert singles.ends["terminated"] > 0


@pytest.mark.parametrize("settings", [{}, ROUGH], ids=["plain", "rough"])
def test_neither_threads_nor_the_other_rows_change_a_row(settings: dict) -> None:
    n = 2 * LEAST_ROWS + 37
    actions = swinging(n, 45)

    def run(rows: slice, **threads: Any) -> list[np.ndarray]:
        envs = make(len(range(n)[rows]), **settings, **threads, max_episode_steps=40)
        out = [envs.reset(seed=list(range(n))[rows])[0]]
        for chosen in actions:
            seen, rewards, terminated, truncated, info = envs.step(chosen[rows])
            out += [seen, rewards, terminated, truncated, info["electrical"], info["mode"]]
        envs.close()
        return out

    alone = run(slice(None))
    for one, other in zip(alone, run(slice(None), num_threads=2), strict=True):
        assert np.array_equal(one, other)
    part = slice(5, 5 + 3)
    for one, other in zip(alone, run(part), strict=True):
        assert np.array_equal(one[part], other)
