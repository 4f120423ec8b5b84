"""Minari datasets in files: each is complete, or it is not there."""

from __future__ import annotations

import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym

from agents.conditions import Conditions
from agents.data.walks import Walks
from rimless_gym.checks import extra
from rimless_gym.presets import BUILDABLE

with extra("data"):
    import h5py  # noqa: F401  with which Minari stores
    from minari import __version__ as minari_version
    from minari.data_collector import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

#: Of all datasets; Minari's identifiers are `namespace/name-v0`.
NAMESPACE = "rimless-wheel"

#: The entry of a dataset's metadata that tells what it was made of.
RECIPE = "rimless_gym"

CARD = "README.md"


def dataset_id(name: str) -> str:
    """The identifier of a walker's dataset; Minari reads only letters, digits and hyphens.

    Raises:
        ValueError: there is neither a letter nor a digit in the name.
    """
    plain = re.sub(r"[\W_]+", "-", name).strip("-")
    if not plain:
        raise ValueError(
            f"{name!r}: a dataset is called by the letters and digits of its walker's name, and "
            "there are none; rename the file"
        )
    return f"{NAMESPACE}/{plain}-v0"


def recipe_of(folder: Path, name: str) -> dict[str, Any] | None:
    """What the dataset of this identifier was made of; None if there is none.

    Raises:
        ValueError: there is one, but rimless-gym has not made it.
    """
    place = folder / name
    if not place.exists():
        return None
    try:
        return dict(MinariStorage.read_raw_metadata(place / "data")[RECIPE])
    except (ValueError, KeyError) as error:
        raise ValueError(
            f"{place}: is there, but is not a dataset of rimless-gym; choose another --out, or "
            "remove it"
        ) from error


def write_dataset(
    folder: Path, name: str, walks: Walks, recipe: Mapping[str, Any], card: str
) -> None:
    """Write a dataset and its card; it appears in the folder when it is complete.

    Args:
        folder: Minari's root, `MINARI_DATASETS_PATH`.
        name: the dataset's identifier.
        walks: that it holds.
        recipe: plain JSON values by which `recipe_of` knows it again.
        card: its text.

    Raises:
        OSError: the disk is full, or the folder cannot be written.
    """
    unfinished = folder / ".unfinished" / name
    shutil.rmtree(unfinished, ignore_errors=True)
    (unfinished / "data").mkdir(parents=True)
    storage = MinariStorage.new(
        unfinished / "data", env_spec=spec_of(walks.conditions, walks.steps)
    )
    storage.update_metadata(
        {
            "dataset_id": name,
            "minari_version": minari_version,
            "author": {"The rimless-gym authors"},
            "algorithm_name": walks.made,
            "description": card,
            "requirements": ["rimless-gym"],
            RECIPE: dict(recipe),
        }
    )
    storage.update_episodes(
        EpisodeBuffer(
            seed=one.seed,
            options=one.options,
            observations=one.observations,
            actions=one.actions,
            rewards=one.rewards,
            terminations=one.terminations,
            truncations=one.truncations,
            infos=one.infos,
        )
        for one in walks.episodes
    )
    (unfinished / CARD).write_text(card)
    (folder / name).parent.mkdir(parents=True, exist_ok=True)
    unfinished.rename(folder / name)
    shutil.rmtree(folder / ".unfinished")


def spec_of(conditions: Conditions, steps: int) -> Any:
    """The environment of some conditions, as Gymnasium's `EnvSpec`."""
    arguments: dict[str, Any] = {}
    if conditions.params != BUILDABLE:
        arguments["params"] = conditions.params
    if conditions.commanded:
        arguments |= {"speeds": conditions.control.speeds}
    env = gym.make(
        environment(conditions),
        max_episode_steps=steps,
        control_period=conditions.control.period,
        **arguments,
    )
    return env.spec


def environment(conditions: Conditions) -> str:
    """The registered environment of some conditions."""
    return "RimlessWheelSpeed-v0" if conditions.commanded else "RimlessWheel-v0"
