"""What a row of the study is."""

from __future__ import annotations

import dataclasses

from scripts.studies.learning.trials import Trial


@dataclasses.dataclass(frozen=True)
class Row:
    """A way to learn, over several seeds.

    Attributes:
        name: of its files, and on the command line.
        title: in the table.
        table: in which it stands, one of those of `rows`.
        trial: how a seed is trained and judged.
        enough: a seed walks if this share of its starts does.
        minutes: that a seed takes, about, before one has been timed.
        machine: the name of its preset; None: the study's.
        one_by_one: whether its seeds stand in the table of `rows.SEEDS` too.
    """

    name: str
    title: str
    table: str
    trial: Trial
    enough: float = 0.95
    minutes: float = 5.0
    machine: str | None = None
    one_by_one: bool = False

    def brief(self) -> Row:
        """The same with a trial that shows that everything runs."""
        return dataclasses.replace(self, trial=self.trial.brief())
