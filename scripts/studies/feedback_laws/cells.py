"""The study's cells: a column of a law about a gait, and what a kept result was measured with."""

from __future__ import annotations

import dataclasses
import hashlib
import time
from pathlib import Path
from typing import Any, NamedTuple

from scripts.studies.feedback_laws.columns import COLUMNS, TIMING
from scripts.studies.feedback_laws.sizes import Sizes, sizes_for
from scripts.studies.feedback_laws.subject import Subject, subject_of

#: A slow law's cells take about so much longer than those of a fast one.
SLOWER = 10.0


class Cell(NamedTuple):
    """A column of a law about a gait.

    Attributes:
        gait: its key.
        law: its name.
        column: its name in `COLUMNS`.
        slow: whether the law is slow.
        quick: whether this is a trial.
    """

    gait: str
    law: str
    column: str
    slow: bool
    quick: bool

    @property
    def key(self) -> str:
        """For a file."""
        return f"{self.gait}_{self.law}_{self.column}"

    @property
    def sizes(self) -> Sizes:
        """How much is measured."""
        return sizes_for(self.slow, self.quick)

    @property
    def seconds(self) -> float:
        """About how long it takes (s)."""
        return COLUMNS[self.column].seconds * (SLOWER if self.slow else 1.0)

    def made_of(self, gait: Path) -> str:
        """A digest of the gait's file and the sizes.

        A kept result with another digest is out of date.
        """
        sources = [gait.read_bytes(), repr(dataclasses.astuple(self.sizes)).encode()]
        return hashlib.sha256(b"\0".join(sources)).hexdigest()


def cells(gaits: list[str], names: list[str], slow: set[str], quick: bool) -> list[Cell]:
    """All cells but those of the timing; those of a gait stand together and share its catch."""
    return [
        Cell(gait, law, column, law in slow, quick)
        for gait in gaits
        for law in names
        for column in COLUMNS
        if column != TIMING
    ]


def measured(cell: Cell, gait: Path) -> dict[str, Any]:
    """The cell's figures, and the time that they took; the error, in words, where there is one."""
    begin = time.process_time()  # other work on this machine does not count
    try:
        subject: Subject = subject_of(gait, cell.law)
        found = COLUMNS[cell.column].measure(subject, cell.sizes)
    except (
        TypeError,
        ValueError,
        RuntimeError,
        ArithmeticError,
    ) as error:  # of one law: others go on
        return {"error": f"{type(error).__name__}: {error}"}
    return {"found": found, "seconds": time.process_time() - begin}
