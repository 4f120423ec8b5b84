"""What one seed of the search knows at one speed and number of steps, and its file."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from trajopt.files import read_arrays, write_arrays
from trajopt.ocp.trajectory import PhaseTrajectory, phases_from_arrays, phases_to_arrays

FORMAT = "rimless-gym front cell 1"

#: Gaits of one family are the same if their costs of transport differ by less (relative).
SAME_COT = 1e-4

#: Gaits that are kept of every family (number of turns): the best ones.
KEPT = 2


class CellFileError(ValueError):
    """A file is no cell of this version, or was damaged."""


@dataclasses.dataclass(frozen=True)
class Found:
    """A gait on the search's mesh.

    Attributes:
        speed: m/s.
        turns: whole turns of the pendulum in a stride.
        cot: cost of transport (E+), on the search's mesh.
        phases: one per step.
        origin: how it was found, in words.
    """

    speed: float
    turns: int
    cot: float
    phases: tuple[PhaseTrajectory, ...] = dataclasses.field(repr=False, compare=False)
    origin: str = ""

    @property
    def steps(self) -> int:
        """Per stride."""
        return len(self.phases)

    @property
    def key(self) -> str:
        """Tells gaits apart."""
        return f"{self.speed:.4f} m/s, {self.steps} steps, {self.turns} turns, CoT {self.cot:.6g}"

    def same_as(self, other: Found) -> bool:
        """Whether both are one gait of one speed and number of steps."""
        return self.turns == other.turns and math.isclose(self.cot, other.cot, rel_tol=SAME_COT)


class Place(NamedTuple):
    """Where a cell is: seed of the search, speed (m/s), and steps per stride."""

    seed: int
    speed: float
    steps: int

    @property
    def file(self) -> str:
        """The name of its file."""
        return f"seed{self.seed}_{self.steps}_steps_{self.speed:.4f}.npz"


class Attempt(NamedTuple):
    """A solve, and what came of it.

    Attributes:
        turns: of the family.
        label: which random start it was, or the key of what was led or joined.
        led: whether known gaits were led here from another speed, or joined; not a random start.
        found: the gait, if there is one.
        seconds: of computing.
    """

    turns: int
    label: str
    led: bool
    found: Found | None
    seconds: float


@dataclasses.dataclass(frozen=True)
class Cell:
    """What was tried and found.

    Attributes:
        place: its seed, speed and steps.
        gaits: different ones, best first.
        starts: random starts by turns: how many were tried, and how many became gaits.
        led: keys of the gaits that were led here or joined, with success or not.
        seconds: of computing.
    """

    place: Place
    gaits: tuple[Found, ...] = ()
    starts: Mapping[int, tuple[int, int]] = dataclasses.field(default_factory=dict)
    led: frozenset[str] = frozenset()
    seconds: float = 0.0

    @property
    def best(self) -> Found | None:
        """The cheapest gait, if there is any."""
        return self.gaits[0] if self.gaits else None

    def tried(self, turns: int) -> int:
        """Random starts that were tried with so many turns."""
        return self.starts.get(turns, (0, 0))[0]

    def knows(self, gait: Found) -> bool:
        """Whether the gait is among those found."""
        return any(gait.same_as(known) for known in self.gaits)

    def after(self, attempt: Attempt) -> Cell:
        """The cell with one more attempt."""
        starts, led = dict(self.starts), self.led
        if attempt.led:
            led |= {attempt.label}
        else:
            tried, good = starts.get(attempt.turns, (0, 0))
            starts[attempt.turns] = (tried + 1, good + (attempt.found is not None))
        cell = dataclasses.replace(
            self, starts=starts, led=led, seconds=self.seconds + attempt.seconds
        )
        return cell if attempt.found is None else cell.with_gait(attempt.found)

    def having_led(self, keys: frozenset[str]) -> Cell:
        """The cell to which gaits of these keys have been led."""
        return dataclasses.replace(self, led=keys)

    def with_gait(self, gait: Found) -> Cell:
        """The cell with one more gait, unless it is known already."""
        if self.knows(gait):
            return self
        gaits: list[Found] = []
        for each in sorted([*self.gaits, gait], key=lambda g: g.cot):
            if sum(each.turns == other.turns for other in gaits) < KEPT:
                gaits.append(each)
        return dataclasses.replace(self, gaits=tuple(gaits))


def save(folder: Path, cell: Cell) -> None:
    """Write a cell to its file."""
    header: dict[str, Any] = {
        "place": list(cell.place),
        "starts": {str(turns): list(count) for turns, count in sorted(cell.starts.items())},
        "led": sorted(cell.led),
        "seconds": cell.seconds,
        "gaits": [[g.turns, g.cot, g.origin] for g in cell.gaits],
    }
    arrays: dict[str, Any] = {}
    for i, gait in enumerate(cell.gaits):
        arrays |= phases_to_arrays(gait.phases, f"gait{i}_")
    write_arrays(folder / cell.place.file, FORMAT, header, arrays)


def load(path: Path) -> Cell:
    """Read a cell.

    Raises:
        CellFileError: the file is no cell of this version, or was damaged.
    """
    header, arrays = read_arrays(path, FORMAT, CellFileError, "delete it, and search again")
    place = Place(*header["place"])
    gaits = tuple(
        Found(place.speed, turns, cot, phases_from_arrays(arrays, f"gait{i}_"), origin)
        for i, (turns, cot, origin) in enumerate(header["gaits"])
    )
    starts = {int(turns): (tried, good) for turns, (tried, good) in header["starts"].items()}
    return Cell(place, gaits, starts, frozenset(header["led"]), header["seconds"])
