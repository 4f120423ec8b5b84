"""Minari datasets: walks of a policy, or of the optimal gaits, with a card.

A dataset is complete, or it is not there; those that are there are not written again.
"""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from agents.conditions import Conditions
from agents.policy_files import (
    ADAPTIVE,
    BASELINES,
    PRETRAINED,
    load_policy,
    named_policy,
    origin,
)
from agents.rollout import Episode, Policy, episodes
from rimless_gym import __version__
from rimless_gym.checks import extra
from rimless_gym.envs.task import TERM_NAMES
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE
from trajopt import periodic_gait
from trajopt.feedback import laws
from trajopt.feedback.law import Floats
from trajopt.gaits.fronts import cot_front
from trajopt.gaits.solution import Solution

with extra("data"):
    import h5py  # noqa: F401  with which Minari stores
    from minari import __version__ as minari_version
    from minari.data_collector import EpisodeBuffer
    from minari.dataset.minari_storage import MinariStorage

#: The entry of a dataset's metadata that records what it was made of, and the name of its card.
RECIPE, CARD = "rimless_gym", "README.md"

#: The dataset of optimal gaits.
OPTIMAL = "optimal"

#: Speeds of its gaits (m/s); each is that nearest at which a step is a whole number of intervals.
SPEEDS = (0.4, 0.45, 0.5, 0.53, 0.56, 0.58, 0.6, 0.62, 0.635)

#: Steps of an episode on a gait. Nothing stabilises it, and rounding grows in each stride.
OPTIMAL_STEPS = 160

#: Entries of `info` that are stored: the terms of the reward, and what a CoT needs.
STORED = (*TERM_NAMES, "distance", "electrical_positive", "idle")

#: The folder of solved gaits in the folder of the datasets; Minari reads no such names.
GAITS = ".gaits"

CARD_TEXT = """\
# `{id}`

Walks of {made}, in `{env}` of rimless-gym: {episodes} episodes, {steps:,} steps, mean return
{mean:.3f} m. Made by `rimless data {name}` of version {version}. Licence: MIT, as rimless-gym.

```python
import minari, rimless_gym  # with MINARI_DATASETS_PATH set to the folder that --out named
dataset = minari.load_dataset("{id}")
env = dataset.recover_environment()
```

Every episode can be walked again, bit for bit: reset the environment with the `seed` (and the
`options`, if any) in the episode's metadata, and step it with the recorded actions.
"""


@dataclasses.dataclass(frozen=True)
class DatasetConfig:
    """What datasets hold."""

    params: WheelParams | None  # the machine; None: a policy's own, and BUILDABLE for the others
    episodes: int  # of every policy; the optimal gaits have one episode each
    seed: int  # of the first episode, and of random voltages
    speed: float  # of the gait that laws hold (m/s)

    def recipe(self, name: str) -> dict[str, Any]:
        """What the dataset of a policy is made of, as plain JSON values.

        Raises:
            CheckpointError: there is no such policy.
        """
        recipe = dataclasses.asdict(self) | {"policy": name, "version": __version__}
        recipe["params"] = self.params and self.params.to_dict()
        if name not in (OPTIMAL, ADAPTIVE, *BASELINES, *laws.names()):
            recipe["weights"] = origin(name)
        return dict(json.loads(json.dumps(recipe)))


def standard(params: WheelParams | None) -> tuple[str, ...]:
    """The policies of which datasets are written unless others are named.

    Those that come with the package are among them where their machine is not another one.
    """
    fast = (name for name in laws.names() if name not in laws.SLOW)
    shipped = (name for name in PRETRAINED if params in (None, load_policy(name).params))
    return (OPTIMAL, "random", *fast, *shipped)


def missing(folder: Path, names: Sequence[str], config: DatasetConfig) -> list[str]:
    """The policies whose datasets are still missing.

    Raises:
        ValueError: two policies would have one identifier, or a dataset of other walks has it.
        CheckpointError: there is no such policy.
    """
    ids = {name: dataset_id(Path(name).stem) for name in names}
    if len(set(ids.values())) < len(ids):
        raise ValueError(f"{' '.join(names)}: two of these have the same name; rename a file")
    recipes = {name: _recipe_of(folder, id_) for name, id_ in ids.items()}
    for name, recipe in recipes.items():
        if recipe not in (None, config.recipe(name)):
            raise ValueError(
                f"{folder / ids[name]}: is there already, made of {recipe}; choose another --out, "
                "or remove it"
            )
    return [name for name, recipe in recipes.items() if recipe is None]


def write(folder: Path, name: str, config: DatasetConfig) -> tuple[str, dict[str, Any]]:
    """Walk, and write the dataset of a policy; return its identifier and its figures.

    Raises:
        NoGaitError: a law has no gait to hold.
        OSError: the disk is full, or the folder cannot be written.
    """
    if name == OPTIMAL:
        (folder / GAITS).mkdir(exist_ok=True)
        walks = optimal_walks(config.params or BUILDABLE, folder / GAITS, config.seed)
    else:
        walks = walks_of(name, config)
    id_, totals = dataset_id(Path(name).stem), [episode.total for episode in walks.episodes]
    figures = {
        "episodes": len(totals),
        "steps": sum(len(episode.rewards) for episode in walks.episodes),
        "mean": float(np.mean(totals)),
    }
    card = CARD_TEXT.format(
        id=id_,
        made=walks.made,
        env=_environment(walks.conditions),
        name=name,
        version=__version__,
        **figures,
    )
    write_dataset(folder, id_, walks, config.recipe(name), card)
    return id_, figures


@dataclasses.dataclass(frozen=True)
class DatasetWalks:
    """Episodes, truncated after so many steps; `made` names the policy in words."""

    made: str
    conditions: Conditions
    steps: int
    episodes: list[Episode]


def walks_of(name: str, config: DatasetConfig) -> DatasetWalks:
    """Episodes from the environment's own starts; episode i is reset with `seed + i`."""

    def gait_for(params: WheelParams) -> Solution:
        return periodic_gait(params, config.speed, hold=CONTROL_PERIOD)

    named = named_policy(name, gait_for, config.params, seed=config.seed)
    steps = named.conditions.control.episode_steps
    envs = named.conditions.envs(config.episodes, max_episode_steps=steps)
    walked = episodes(envs, named.policy, config.seed, keep=STORED, progress=name)
    made = f"the policy `{Path(name).stem}`"
    if named.gait is not None:
        made = f"the feedback law `{name}` about the optimal gait at {named.gait.speed:.3f} m/s"
    return DatasetWalks(made, named.conditions, steps, walked)


def optimal_walks(
    params: WheelParams, folder: Path, seed: int, speeds: Sequence[float] = SPEEDS
) -> DatasetWalks:
    """An episode on each of some optimal gaits, its voltages repeated stride after stride.

    What is drawn from the seed changes nothing.

    Raises:
        NoGaitError: no gait was found.
    """
    front = cot_front(params, speeds, [1], hold=CONTROL_PERIOD, folder=folder)
    conditions = Conditions(params)
    walked = [
        episode
        for i, gait in enumerate(front.envelope)
        for episode in episodes(
            conditions.envs(1, max_episode_steps=OPTIMAL_STEPS),
            _open_loop(gait),
            seed + i,
            options={"state": gait.state(gait.first_tick).tolist()},
            keep=STORED,
        )
    ]
    listed = ", ".join(f"{gait.speed:.3f}" for gait in front.envelope)
    made = f"optimal gaits at {listed} m/s, their voltages held for 10 ms and repeated in open loop"
    return DatasetWalks(made, conditions, OPTIMAL_STEPS, walked)


def _open_loop(gait: Solution) -> Policy:
    """The voltages of a held gait from its first tick on, whatever the state."""
    actions, tick = gait.held_voltages / gait.params.voltage_limit, 0

    def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
        nonlocal tick
        tick += 1
        return np.full(len(states), actions[(tick - 1) % len(actions)])

    return policy


def dataset_id(name: str) -> str:
    """The identifier of a policy's dataset; Minari reads only letters, digits and hyphens."""
    plain = re.sub(r"[\W_]+", "-", name).strip("-")
    return f"rimless-wheel/{plain}-v0"


def _recipe_of(folder: Path, id_: str) -> object:
    """What the dataset of this identifier was made of; None if there is none."""
    if not (folder / id_).exists():
        return None
    return MinariStorage.read_raw_metadata(folder / id_ / "data").get(RECIPE, "other walks")


def write_dataset(
    folder: Path, id_: str, walks: DatasetWalks, recipe: Mapping[str, Any], card: str
) -> None:
    """Write a dataset and its card; it appears in the folder when it is complete."""
    unfinished = folder.resolve() / ".unfinished" / id_  # Minari joins relative paths twice
    shutil.rmtree(unfinished, ignore_errors=True)
    (unfinished / "data").mkdir(parents=True)
    storage = MinariStorage.new(
        unfinished / "data", env_spec=_spec_of(walks.conditions, walks.steps)
    )
    storage.update_metadata(
        {
            "dataset_id": id_,
            "minari_version": minari_version,
            "author": {"The rimless-gym authors"},
            "algorithm_name": walks.made,
            "description": card,
            "requirements": ["rimless-gym"],
            RECIPE: dict(recipe),
        }
    )
    names = (
        *("seed", "options", "observations", "actions", "rewards"),
        *("terminations", "truncations", "infos"),
    )
    storage.update_episodes(
        EpisodeBuffer(**{name: getattr(episode, name) for name in names})
        for episode in walks.episodes
    )
    (unfinished / CARD).write_text(card)
    (folder / id_).parent.mkdir(parents=True, exist_ok=True)
    unfinished.rename(folder / id_)
    shutil.rmtree(folder / ".unfinished")


def _spec_of(conditions: Conditions, steps: int) -> Any:
    """The environment of some conditions, as Gymnasium's `EnvSpec`."""
    arguments: dict[str, Any] = {}
    if conditions.params != BUILDABLE:
        arguments["params"] = conditions.params
    if conditions.commanded:
        arguments["speeds"] = conditions.control.speeds
    env = gym.make(
        _environment(conditions),
        max_episode_steps=steps,
        control_period=conditions.control.period,
        **arguments,
    )
    return env.spec


def _environment(conditions: Conditions) -> str:
    """The registered environment of some conditions."""
    return "RimlessWheelSpeed-v0" if conditions.commanded else "RimlessWheel-v0"
