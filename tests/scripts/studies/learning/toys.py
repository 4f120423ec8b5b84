"""A training that takes no time, and the shortest walks to judge a policy by."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from agents.protocol import PROTOCOL
from rimless_gym import BUILDABLE
from rimless_gym.hybrid import CONTROL_PERIOD
from scripts.studies.learning.cells import Cell
from scripts.studies.learning.figures import Figures
from scripts.studies.learning.row import Row
from scripts.studies.learning.rows import LEARNED
from scripts.studies.learning.study import Study
from trajopt.processes import cores

#: Two short walks.
FEW = dataclasses.replace(PROTOCOL, starts=2, duration=1.0, window=0.5, alive=0.5)

STANDS = Figures(share=0.0, falls=0.0, slips=0.0, cot=None, speed=None)


@dataclasses.dataclass(frozen=True)
class Toy:
    """A training that counts to ten, and may be stopped before it gets there.

    Its policy walks as its seed says: those of `standing` seeds stand.
    """

    standing: tuple[int, ...] = ()
    period: float = CONTROL_PERIOD
    stops_at: int | None = None
    fails: bool = False

    @property
    def settings(self) -> dict[str, Any]:
        return {"standing": list(self.standing)}

    def train(self, seed: int, folder: Path, params: Any) -> int:
        if self.fails:
            raise ValueError("this learner cannot learn")
        assert cores() == 1
        counted = folder / "counted"
        with counted.open("a") as file:
            for _ in range(len(counted.read_text()), 10):
                if len(counted.read_text()) == self.stops_at:
                    raise KeyboardInterrupt
                file.write(f"{seed}")
                file.flush()
        return 1000 * (seed + 1)

    def judge(self, folder: Path, params: Any, by: Any) -> dict[str, Figures]:
        seed = int(folder.name.rpartition("_")[2])
        walks = Figures(share=1.0, falls=0.0, slips=0.0, cot=0.06 + 0.001 * seed, speed=0.56)
        return {"best": STANDS if seed in self.standing else walks, "last": walks}

    def brief(self) -> Toy:
        return self


def toy(name: str = "toy", table: str = LEARNED, **fields: Any) -> Row:
    return Row(name, f"a {name}", table, Toy(**fields))


def cells_of(row: Row, seeds: int = 3) -> list[Cell]:
    return Study((row,), seeds, BUILDABLE).cells()
