"""Minari collects episodes with all of their infos."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest

import rimless_gym

pytestmark = pytest.mark.peers
pytest.importorskip("minari")
pytest.importorskip("jax")  # with which it collects

import minari  # noqa: E402

ARGUMENTS = {"params": rimless_gym.PROTOTYPE, "task": rimless_gym.Task(distance_weight=0.8)}


def collected(tmp_path, monkeypatch) -> tuple[minari.MinariDataset, list[list[dict]]]:
    """A data set of three episodes, and the infos of the same episodes as they were given."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    env = gym.make("RimlessWheel-v0", max_episode_steps=60, **ARGUMENTS)
    collector = minari.DataCollector(env, record_infos=True)
    rng, given = np.random.default_rng(0), []
    for seed in range(3):
        infos, ended = [collector.reset(seed=seed)[1]], False
        while not ended:
            command = rng.uniform(-1, 1, 1).astype(np.float32)
            *_, terminated, truncated, info = collector.step(command)
            infos.append(dict(info))
            ended = terminated or truncated
        given.append(infos)
    dataset = collector.create_dataset(
        "rimless/wheel-v0",
        algorithm_name="noise",
        author="nobody",
        author_email="nobody@example.org",
        code_permalink="none",
        description="random voltages",
        eval_env=env.spec,
    )
    return dataset, given


def test_every_entry_of_info_is_stored_as_it_was_given(tmp_path, monkeypatch):
    dataset, given = collected(tmp_path, monkeypatch)
    for episode, infos in zip(dataset.iterate_episodes(), given, strict=True):
        assert set(episode.infos) == set(infos[0])
        for name, values in episode.infos.items():
            assert values.dtype.kind in "bif"
            np.testing.assert_array_equal(values, [info[name] for info in infos])
