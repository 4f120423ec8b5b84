"""Walks as Minari datasets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import minari
import numpy as np
import pytest

from agents.datasets import (
    CARD,
    DatasetConfig,
    dataset_id,
    missing,
    optimal_walks,
    standard,
    write,
    write_dataset,
)
from agents.policy_files import PRETRAINED
from rimless_gym import BUILDABLE, PROTOTYPE

FEW = DatasetConfig(None, 2, 11, 0.56)


def require_repeated(dataset: Any) -> None:
    """Step the environment of a dataset with what is recorded in it."""
    env = dataset.recover_environment()
    metadata = dataset.storage.get_episode_metadata(range(dataset.total_episodes))
    for about, episode in zip(metadata, dataset.iterate_episodes(), strict=True):
        observation, _ = env.reset(seed=about["seed"], options=about.get("options"))
        np.testing.assert_array_equal(observation, episode.observations[0])
        for k, action in enumerate(episode.actions):
            observation, reward, terminated, truncated, _ = env.step(action)
            np.testing.assert_array_equal(observation, episode.observations[k + 1])
            assert reward == episode.rewards[k]
            assert (terminated, truncated) == (episode.terminations[k], episode.truncations[k])
        assert terminated or truncated


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Datasets of noise and of an evolved policy."""
    made = tmp_path_factory.mktemp("data")
    for name in ("random", "evolution"):
        write(made, name, FEW)
    return made


@pytest.fixture
def local(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same, as Minari's local storage."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    return folder


def test_the_environment_repeats_what_minari_reads_to_the_bit(local: Path) -> None:
    assert set(minari.list_local_datasets()) == {dataset_id("random"), dataset_id("evolution")}
    for name in minari.list_local_datasets():
        dataset = minari.load_dataset(name)
        assert dataset.total_episodes == 2
        require_repeated(dataset)
    for episode in minari.load_dataset("rimless-wheel/random-v0").iterate_episodes():
        terms = [values[1:] for name, values in episode.infos.items() if name.startswith("reward_")]
        np.testing.assert_allclose(sum(terms), episode.rewards, rtol=0, atol=1e-12)


def test_what_is_there_stays_and_what_was_cut_off_is_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cut(*arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("agents.datasets.MinariStorage.update_metadata", cut)
        with pytest.raises(KeyboardInterrupt):
            write(tmp_path, "idle", FEW)
    assert missing(tmp_path, ("idle", "random"), FEW) == ["idle", "random"]
    monkeypatch.chdir(tmp_path.parent)
    write(Path(tmp_path.name), "idle", FEW)  # a relative folder
    assert missing(tmp_path, ("idle", "random"), FEW) == ["random"]


def test_a_dataset_of_other_walks_is_neither_taken_nor_replaced(folder: Path) -> None:
    for other in (DatasetConfig(None, 4, 11, 0.56), DatasetConfig(PROTOTYPE, 2, 11, 0.56)):
        with pytest.raises(ValueError, match=r"random-v0: is there already.*choose another --out"):
            missing(folder, ["random"], other)


def test_policies_of_another_machine_are_not_among_those_written_by_default() -> None:
    assert set(standard(None)) - set(standard(PROTOTYPE)) == set(PRETRAINED)
    assert standard(BUILDABLE) == standard(None)


def test_two_names_of_one_identifier_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="two of these have the same name"):
        missing(tmp_path, ["a/best.zip", "b/best.zip"], FEW)


def test_another_machine_and_commanded_speeds_are_recovered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    write(tmp_path, "idle", DatasetConfig(PROTOTYPE, 1, 0, 0.56))
    dataset = minari.load_dataset("rimless-wheel/idle-v0")
    assert dataset.recover_environment().unwrapped.params == PROTOTYPE
    write(tmp_path, "front", DatasetConfig(None, 1, 0, 0.56))
    dataset = minari.load_dataset(dataset_id("front"))
    assert dataset.recover_environment().unwrapped.control.speeds == (0.5, 0.63)
    assert (
        dataset.storage.metadata["description"]
        == (tmp_path / dataset.spec.dataset_id / CARD).read_text()
    )


@pytest.mark.slow
def test_optimal_gaits_are_walked_at_their_cost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    walks = optimal_walks(BUILDABLE, tmp_path, 0, (0.56, 0.6))
    for episode, speed in zip(walks.episodes, (0.56, 0.6), strict=True):
        assert episode.truncations[-1]
        sums = {name: values.sum() for name, values in episode.infos.items()}
        assert sums["distance"] / (0.01 * walks.steps) == pytest.approx(
            speed, rel=0.15
        )  # no whole strides
        cot = (sums["electrical_positive"] + sums["idle"]) / (BUILDABLE.weight * sums["distance"])
        assert cot == pytest.approx(0.048, abs=0.01)
    write_dataset(tmp_path, dataset_id("optimal"), walks, {}, "a card")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    require_repeated(minari.load_dataset(dataset_id("optimal")))
