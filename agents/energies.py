"""Where a walk's energy goes, by term of the ledger: as bars that fill while it walks."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import accumulate

from agents.recording import DRAWN, Recording
from rimless_gym.equations import LOSSES
from rimless_gym.rendering.canvas import STANCE, Colour, Frame
from rimless_gym.rendering.panels import draw_spending

#: Terms that never reach as much energy (J) are left out.
NOTHING = 1e-6


def drawn_between(walk: Recording, since: float, time: float) -> float:
    """E+ from one time (s) to another (J): drawn from a battery that cannot be recharged."""
    before, after = (walk.spent(t) for t in (since, time))
    return sum(after[name] - before[name] for name in DRAWN)


def spent_between(walk: Recording, since: float, time: float) -> dict[str, float]:
    """Where that energy went (J), by term of the ledger in words; the sum of all is what was drawn.

    The battery cannot be recharged, so that what the motor gives back is lost: "not recharged".
    What pushes give counts as negative.
    """
    before, after = (walk.spent(t) for t in (since, time))
    of = {name: after[name] - before[name] for name in after}
    spent = {name: of[name] for name in ("idle", *LOSSES, "collision")}
    spent |= {"not recharged": of["electrical_positive"] - of["electrical"], "push": -of["push"]}
    return spent | {"change of mechanical energy": of["mechanical_change"]}


@dataclasses.dataclass(frozen=True)
class Chapter:
    """A part of a walk, whose energies are counted from its beginning.

    Attributes:
        walk: the walk.
        since: where the part begins (s).
        until: where it ends (s).
        title: of the picture.
        terms: those of `spent_between` that are ever more than nothing.
        full: the energy of a full bar (J).
    """

    walk: Recording
    since: float
    until: float
    title: str
    terms: tuple[str, ...]
    full: float

    @classmethod
    def of(cls, walk: Recording, since: float, until: float, title: str) -> Chapter:
        """The part of a walk between two times (s)."""
        first, last = walk.index(since), walk.index(until)
        times = [walk.begins + k * walk.period for k in range(first, last + 1)]
        moments = [spent_between(walk, since, time) for time in times]
        terms = tuple(
            name for name in moments[0] if max(abs(each[name]) for each in moments) > NOTHING
        )
        full = max(max(accumulate(each.values())) for each in moments)
        return cls(walk, since, until, title, terms, max(full, NOTHING))

    def frame(
        self, time: float, others: Sequence[tuple[Recording, Colour]], size: tuple[int, int]
    ) -> Frame:
        """The bars at a time (s).

        Args:
            time: within the chapter.
            others: walks whose drawn energy is shown beside the first one's, and their colours.
            size: width and height in pixels.
        """
        drawn = {"battery": (drawn_between(self.walk, self.since, time), STANCE)}
        for other, colour in others:
            drawn[f"battery, {other.name}"] = drawn_between(other, self.since, time), colour
        spent = spent_between(self.walk, self.since, time)
        named = {name: spent[name] for name in self.terms}
        full = [drawn_between(other, self.since, self.until) for other, _ in others]
        return draw_spending(self.title, drawn, named, max(self.full, *full, NOTHING), size)


def chapters(walk: Recording) -> tuple[Chapter, ...]:
    """How the wheel gets to walk, and then its walk: getting there costs more than walking.

    A single one where it has no figures.
    """
    measured = walk.measured_from
    if measured is None:
        return (Chapter.of(walk, walk.begins, walk.ends, "energy since the start (J)"),)
    title = f"energy of the first {measured.time:.1f} s (J)"
    return (
        Chapter.of(walk, walk.begins, measured.time, title),
        Chapter.of(walk, measured.time, walk.ends, f"energy since {measured.time:.1f} s (J)"),
    )
