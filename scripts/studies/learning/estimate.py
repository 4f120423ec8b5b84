"""How long a study will still take."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from statistics import fmean

from scripts.studies.learning.cells import Cell, Result


class Estimate:
    """The time that is left, from that of the cells which are finished.

    Args:
        todo: cells that are still to be run.
        results: of those that are finished.
        workers: that share the work.
    """

    def __init__(self, todo: Sequence[Cell], results: Mapping[Cell, Result], workers: int) -> None:
        self._todo, self._workers, self._begun = list(todo), workers, time.monotonic()
        self._taken: dict[str, list[float]] = {}
        for cell, result in results.items():
            self._taken.setdefault(cell.row.name, []).append(result.minutes)

    def finished(self, cell: Cell, result: Result | None) -> None:
        """A cell is finished; without a result it failed, and says nothing about the others."""
        self._todo.remove(cell)
        self._begun = time.monotonic()
        if result is not None:
            self._taken.setdefault(cell.row.name, []).append(result.minutes)

    @property
    def minutes(self) -> float:
        """Estimated minutes left. All workers have gone on since the last cell was finished."""
        left = [self._expected(cell) for cell in self._todo]
        if not left:
            return 0.0
        since = (time.monotonic() - self._begun) / 60.0
        return max(sum(left) / min(self._workers, len(left)) - since, 0.0)

    @property
    def words(self) -> str:
        """For the bar."""
        return f"about {self.minutes:.0f} min left" if self._todo else ""

    def _expected(self, cell: Cell) -> float:
        taken = self._taken.get(cell.row.name)
        return fmean(taken) if taken else cell.row.minutes
