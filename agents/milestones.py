"""How far a training had come when it was evaluated: a point of its learning curve."""

from __future__ import annotations

import dataclasses

from agents.evaluate import Evaluation


@dataclasses.dataclass(frozen=True)
class Milestone:
    """A periodic evaluation of a training.

    Attributes:
        intervals: control intervals so far, all environments together.
        minutes: of one core so far, those before a stop included.
        walking_share: of the starts, in [0, 1].
        speed: of those that walk (m/s); NaN if none does.
        cot: of those that walk; NaN if none does.
        objective: mean reward per second over all starts (m/s).
    """

    intervals: int
    minutes: float
    walking_share: float
    speed: float
    cot: float
    objective: float

    @classmethod
    def of(cls, evaluation: Evaluation, intervals: int, minutes: float) -> Milestone:
        """The figures of an evaluation, and when it was."""
        figures = ("walking_share", "speed", "cot", "objective")
        return cls(intervals, minutes, *(float(getattr(evaluation, name)) for name in figures))
