"""Everything that the search has found so far: its cells, kept in files, and its envelopes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from rimless_gym.params import WheelParams
from scripts.studies.fronts.cells import Attempt, Cell, CellFileError, Found, Place, load, save

#: Numbers of steps per stride that are searched.
STEPS = (1, 2, 3)


class Board:
    """The cells of all seeds. Every change of a cell is written to its file at once.

    Attributes:
        params: the machine.
        folder: of the cells' files.
        cells: by place.
        grid: speeds (m/s), ascending, rounded to 1e-4 m/s.
    """

    def __init__(self, params: WheelParams, folder: Path) -> None:
        self.params, self.folder = params, folder
        self.cells: dict[Place, Cell] = {}
        for path in sorted(folder.glob("seed*.npz")):
            with suppress(CellFileError):  # a damaged cell is searched again
                cell = load(path)
                self.cells[cell.place] = cell
        self.grid = sorted({place.speed for place in self.cells})

    def cell(self, place: Place) -> Cell:
        """The cell at a place; an empty one where nothing was tried."""
        return self.cells.get(place, Cell(place))

    def keep(self, cell: Cell) -> None:
        """Put a cell in its place, and write it."""
        self.cells[cell.place] = cell
        save(self.folder, cell)

    def add(self, place: Place, attempts: Iterable[Attempt], source: float | None = None) -> None:
        """Count attempts; `source` is the speed from which a gait was led here, if it was."""
        before = cell = self.cell(place)
        for attempt in attempts:
            cell = cell.after(attempt)
            if source is None or attempt.found is None or before.knows(attempt.found):
                continue
            # The way back leads to where it came from.
            back = Attempt(attempt.turns, attempt.found.key, True, None, 0.0)
            self.keep(self.cell(place._replace(speed=source)).after(back))
        self.keep(cell)

    def widen(self, speeds: Iterable[float]) -> int:
        """Add speeds to the grid; how many were new."""
        before = len(self.grid)
        self.grid = sorted({*self.grid, *(round(speed, 4) for speed in speeds)})
        return len(self.grid) - before

    def of(self, seed: int) -> Iterator[Cell]:
        """The cells of a seed, by speed, then steps."""
        ours = sorted((p.speed, p.steps) for p in self.cells if p.seed == seed)
        yield from (self.cells[Place(seed, speed, steps)] for speed, steps in ours)

    def envelope(self, seed: int) -> dict[float, Found]:
        """A seed's cheapest gait at every speed at which it found one, by speed."""
        best: dict[float, Found] = {}
        for cell in self.of(seed):
            gait, speed = cell.best, cell.place.speed
            if gait is not None and (speed not in best or gait.cot < best[speed].cot):
                best[speed] = gait
        return best

    @property
    def seconds(self) -> float:
        """Computing so far, over all processes (s)."""
        return sum(cell.seconds for cell in self.cells.values())
