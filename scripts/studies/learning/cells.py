"""The study's cells: one seed of one row, and the file in which its result is kept."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from agents.protocol import PROTOCOL, Protocol
from agents.stopwatch import minutes
from rimless_gym.checks import extra
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE
from scripts.studies.learning.figures import Figures
from scripts.studies.learning.row import Row
from scripts.studies.learning.trials import RESULT
from trajopt.files import jsonable, read_signed, write_signed
from trajopt.processes import limited_to

with extra("learn"):
    import torch


@dataclasses.dataclass(frozen=True)
class Result:
    """What became of a cell.

    Attributes:
        policies: what distinguishes a policy -> how it walks.
        steps: of the environment, in all.
        minutes: of one core, for training; those before a stop included.
        revision: of the repository that judged it; None where there is no git.
    """

    policies: Mapping[str, Figures]
    steps: int
    minutes: float
    revision: str | None = None


@dataclasses.dataclass(frozen=True)
class Cell:
    """One seed of a row.

    Attributes:
        row: how it is trained and judged.
        seed: of everything random in the training.
        params: the machine.
        protocol: by which it is judged.
    """

    row: Row
    seed: int
    params: WheelParams = BUILDABLE
    protocol: Protocol = PROTOCOL

    @property
    def key(self) -> str:
        """Its name, and that of its folder."""
        return f"{self.row.name}_{self.seed}"

    @property
    def identity(self) -> dict[str, Any]:
        """All that its result depends on besides the code, as plain JSON values."""
        values = {
            "row": self.row.name,
            "seed": self.seed,
            "trial": self.row.trial.settings,
            "params": self.params.to_dict(),
            "protocol": dataclasses.asdict(self.protocol),
        }
        return dict(json.loads(json.dumps(jsonable(values))))

    def run(self, folder: Path) -> Result:
        """Train and judge it, in its folder in that of the study.

        Raises:
            KeyboardInterrupt: somebody asked to stop.
        """
        own = folder / self.key
        own.mkdir(parents=True, exist_ok=True)
        with one_core():
            steps = self.row.trial.train(self.seed, own, self.params)
            policies = self.row.trial.judge(own, self.params, self.protocol)
        return Result(policies, steps, minutes(own))


def keep(folder: Path, cell: Cell, result: Result) -> None:
    """Write the result of a cell; its file is complete or not there."""
    content = {"identity": cell.identity, "result": dataclasses.asdict(result)}
    write_signed(folder / cell.key / RESULT, content)


def kept(folder: Path, cell: Cell) -> Result | None:
    """The result of a cell; None if it has not been finished.

    Raises:
        ValueError: its file is damaged, or the cell was trained or judged in another way.
    """
    path = folder / cell.key / RESULT
    if not path.exists():
        return None
    try:
        content = read_signed(path)
    except ValueError as error:
        raise ValueError(
            f"{error}; remove it to judge its policies again, or remove {path.parent} to train "
            "them anew"
        ) from error
    differing = [k for k, v in cell.identity.items() if content["identity"].get(k) != v]
    if differing:
        raise ValueError(
            f"{path}: of another {' and '.join(differing)} than is asked for; remove {path.parent} "
            "to train anew, or choose another --out"
        )
    values = content["result"]
    policies = {which: Figures.read(each) for which, each in values.pop("policies").items()}
    return Result(policies, **values)


@contextmanager
def one_core() -> Iterator[None]:
    """Within the context, learners and PyTorch use one core; their results are the same.

    A study keeps every core busy with a cell of its own.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with limited_to(1):
            yield
    finally:
        torch.set_num_threads(threads)
