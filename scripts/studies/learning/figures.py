"""What is told of a policy that was judged: a few figures of an evaluation."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from agents.commanded import SLIPS, Stretch
from agents.evaluate import Evaluation
from agents.verdicts import FALLS
from trajopt.files import jsonable


@dataclasses.dataclass(frozen=True)
class Figures:
    """How a policy walks.

    Attributes:
        share: of the starts that walk, in [0, 1].
        falls: of the starts that fall.
        slips: of the starts that still take steps at the end, but whose foot slips.
        cot: cost of transport of those that walk, from E+; None if none gets anywhere.
        speed: of those that walk (m/s); None if none does.
    """

    share: float
    falls: float
    slips: float
    cot: float | None
    speed: float | None

    @classmethod
    def of(cls, evaluation: Evaluation) -> Figures:
        """The figures of an evaluation."""
        faults, starts = evaluation.faults, len(evaluation.verdicts)
        return cls(
            share=evaluation.walking_share,
            falls=faults.get(FALLS, 0) / starts,
            slips=sum(faults.get(verdict, 0) for verdict in SLIPS) / starts,
            cot=jsonable(evaluation.cot),
            speed=jsonable(evaluation.speed),
        )

    @classmethod
    def of_stretch(cls, stretch: Stretch) -> Figures:
        """The figures of the part of a walk under one command."""
        return cls(
            share=stretch.walking_share,
            falls=stretch.fallen_share,
            slips=stretch.slipping_share,
            cot=jsonable(stretch.cot),
            speed=jsonable(stretch.speed),
        )

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> Figures:
        """The figures that a file has."""
        return cls(**values)
