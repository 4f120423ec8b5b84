"""The columns: each is a function of a `Subject` and `Sizes` that returns plain JSON values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from scripts.studies.feedback_laws.columns.attraction import attraction
from scripts.studies.feedback_laws.columns.changes import machines, nuisances, slopes
from scripts.studies.feedback_laws.columns.cost import cost
from scripts.studies.feedback_laws.columns.multipliers import multipliers
from scripts.studies.feedback_laws.columns.pushes import pushes
from scripts.studies.feedback_laws.columns.timing import timing
from scripts.studies.feedback_laws.sizes import Sizes
from scripts.studies.feedback_laws.subject import Subject


class Column(NamedTuple):
    """Something that is measured.

    Attributes:
        measure: the function.
        seconds: that it takes for a fast law, about, for the estimate of the time that is left.
    """

    measure: Callable[[Subject, Sizes], dict[str, Any]]
    seconds: float


#: Which laws are slow follows from this one, so that it comes first.
TIMING = "timing"

COLUMNS = {
    TIMING: Column(timing, 1.5),
    "cost": Column(cost, 12.0),
    "multipliers": Column(multipliers, 1.0),
    "pushes": Column(pushes, 7.0),
    "attraction": Column(attraction, 3.0),
    "nuisances": Column(nuisances, 7.0),
    "slopes": Column(slopes, 3.0),
    "machines": Column(machines, 22.0),
}
