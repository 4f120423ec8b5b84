"""Datasets, one of each walker; those that are there are kept."""

from __future__ import annotations

import dataclasses
import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.baselines import BASELINES
from agents.data.figures import card, figures
from agents.data.files import dataset_id, environment, recipe_of, write_dataset
from agents.data.walks import OPTIMAL, Walks, optimal_walks, walks_of
from agents.policy_files import origin
from rimless_gym import __version__
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE
from trajopt import periodic_gait
from trajopt.feedback import laws
from trajopt.gaits.solution import Solution
from trajopt.provenance import provenance

#: Where gaits are kept that were solved, in the folder of the datasets; Minari reads no such names.
GAITS = ".gaits"


@dataclasses.dataclass(frozen=True)
class Wanted:
    """What datasets shall hold.

    Attributes:
        params: the machine; None: a policy's own, and BUILDABLE for the others.
        episodes: of every walker; the optimal gaits have one episode each.
        seed: of the first episode.
        speed: of the gait that laws hold (m/s).
    """

    params: WheelParams | None
    episodes: int
    seed: int
    speed: float

    def recipe(self, name: str) -> dict[str, Any]:
        """What the dataset of a walker is made of, as plain JSON values.

        Raises:
            CheckpointError: there is no such policy.
        """
        params = None if self.params is None else self.params.to_dict()
        of: dict[str, Any] = {"walker": name, "params": params, "seed": self.seed}
        if name != OPTIMAL:
            of["episodes"] = self.episodes
        if name in laws.names():
            of["speed"] = self.speed
        elif name not in (OPTIMAL, *BASELINES):
            of["policy"] = origin(name)
        return dict(json.loads(json.dumps(of | {"version": __version__})))

    def command(self, name: str) -> str:
        """The command line that writes the dataset of a walker."""
        given = ["rimless", "data", name, "--seed", str(self.seed)]
        if name != OPTIMAL:
            given += ["--episodes", str(self.episodes)]
        if name in laws.names():
            given += ["--speed", f"{self.speed:g}"]
        if self.params is not None:
            given += ["--params", json.dumps(_changed(self.params))]
        return shlex.join(given)

    def walks(self, name: str, gaits: Path) -> Walks:
        """Walk; see `agents.data.walks`."""
        if name == OPTIMAL:
            gaits.mkdir(exist_ok=True)
            return optimal_walks(self.params or BUILDABLE, gaits, self.seed)
        return walks_of(name, self.params, self._gait, self.episodes, self.seed)

    def _gait(self, params: WheelParams) -> Solution:
        return periodic_gait(params, self.speed, hold=CONTROL_PERIOD, progress=True)


def require_free(folder: Path, names: Sequence[str], wanted: Wanted) -> list[str]:
    """The walkers whose datasets are still missing.

    Args:
        folder: of the datasets.
        names: of the walkers.
        wanted: what their datasets shall hold.

    Raises:
        ValueError: two walkers would have one identifier, or a dataset of other walks has it.
        CheckpointError: there is no such policy.
    """
    ids = [dataset_id(Path(name).stem) for name in names]
    for one in ids:
        if ids.count(one) > 1:
            raise ValueError(
                f"two datasets would be called {one}: give one of the files another name"
            )
    recipes = [recipe_of(folder, one) for one in ids]
    for one, found, name in zip(ids, recipes, names, strict=True):
        if found not in (None, wanted.recipe(name)):
            raise ValueError(
                f"{folder / one}: is there already, made of {found}; choose another --out, or "
                "remove it"
            )
    return [name for name, found in zip(names, recipes, strict=True) if found is None]


def write(folder: Path, name: str, wanted: Wanted) -> tuple[str, dict[str, Any]]:
    """Write the dataset of a walker.

    Args:
        folder: of the datasets.
        name: of the walker.
        wanted: what the dataset shall hold.

    Returns:
        The dataset's identifier and its figures.

    Raises:
        NoGaitError: a law has no gait to hold.
        OSError: the disk is full, or the folder cannot be written.
    """
    walks, id_ = wanted.walks(name, folder / GAITS), dataset_id(Path(name).stem)
    found = figures(walks.episodes, walks.conditions.params.weight)
    machine = _changed(walks.conditions.params)
    by = provenance(command=wanted.command(name), machine=machine)
    text = card(id_, environment(walks.conditions), walks, found, by)
    write_dataset(folder, id_, walks, wanted.recipe(name), text)
    return id_, found


def _changed(params: WheelParams) -> dict[str, Any]:
    """The fields in which a machine differs from BUILDABLE."""
    usual = BUILDABLE.to_dict()
    return {name: value for name, value in params.to_dict().items() if value != usual[name]}
