"""Walks as pictures: one alone, or several on one ground with their energies."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import accumulate

import numpy as np

from agents.recording import DRAWN, STEPS, Recording, Touchdown, record_gait
from rimless_gym.equations import LOSSES
from rimless_gym.rendering.canvas import FIRST, OPTIMUM, OTHERS, STANCE, Colour, Frame
from rimless_gym.rendering.panels import Shown, draw_several, draw_spending
from trajopt.gaits.solution import Solution

#: Over what speed and cost are averaged, in words.
AVERAGED = f"over {STEPS} steps"

#: Name of the gait whose ghost is blue.
GHOST = "optimum"

#: Steps by which it walks ahead of the first walk when it joins.
AHEAD = 2

#: Most walks in one picture.
MOST = 2 + len(OTHERS)

#: Letters of a name that are written; of a longer one its end, where paths differ.
LETTERS = 22

#: Width and height (pixels).
SIZE = (720, 468)

#: Share of the height that the walks take.
GROUND = 0.64

#: Title of the energies.
ENERGY = "energy since the start (J)"

#: Energies that are less in the end (J) are left out.
NOTHING = 1e-6


def times(ends: float, fps: float) -> list[float]:
    """When pictures are taken of a walk until it ends (s), one or more."""
    return [k / fps for k in range(max(1, round(ends * fps)))]


class GroupFilm:
    """Walks on one ground.

    Args:
        walks: the first is drawn solid, followed by the camera and measured; the others are ghosts,
            which appear when their recordings begin. `MOST` of them at most, of one machine.
        size: width and height in pixels.

    Attributes:
        size: as given.
        ends: when the last of them has ended (s).
    """

    def __init__(self, walks: Sequence[Recording], size: tuple[int, int] = SIZE) -> None:
        if len(walks) > MOST:
            raise ValueError(f"{len(walks)} walks: at most {MOST} fit into one picture")
        first = walks[0]
        for walk in walks:
            if walk.params != first.params:
                raise ValueError(
                    f"{walk.name}: walks with another machine than {first.name}: "
                    f"{walk.params.differences(first.params)}; watch them one at a time"
                )
        self.size = width, height = size
        self.ends = max(walk.ends for walk in walks)
        titled = [dataclasses.replace(walk, name=_title(walk.name)) for walk in walks]
        self._walks = list(zip(titled, _colours([walk.name for walk in walks]), strict=True))
        self._above = width, round(GROUND * height)
        self._below = width, height - self._above[1]
        spent = spending(first, first.ends)
        self._terms = [term for term, joules in spent.items() if abs(joules) > NOTHING]
        self._full = max(
            *accumulate(spent.values()), *(drawn(walk, walk.ends) for walk in walks), NOTHING
        )

    def frame(self, time: float) -> Frame:
        """The picture at a time (s), uint8 of shape (height, width, 3)."""
        first = self._walks[0][0]
        present = [(walk, colour) for walk, colour in self._walks if walk.begins <= time + 1e-9]
        shown = [
            Shown(name=walk.name, colour=colour, scene=walk.scene(time)) for walk, colour in present
        ]
        batteries = {"battery": (drawn(first, time), STANCE)}
        for walk, colour in present[1:]:
            if walk.begins <= first.begins:  # energies of a shorter walk do not compare
                batteries[f"battery, {walk.name}"] = drawn(walk, time), colour
        spent = spending(first, time)
        below = draw_spending(
            ENERGY, batteries, {term: spent[term] for term in self._terms}, self._full, self._below
        )
        lines = len(self._walks)
        ground = draw_several(first.params, shown, self._above, lines=lines, averaged=AVERAGED)
        return np.concatenate([ground, below])


def ghost(gait: Solution, first: Recording) -> Recording:
    """The optimum, in step with a walk: it joins at the touchdown from which that has figures.

    It begins `AHEAD` steps ahead, so that both are visible; with the walk if that has no figures.
    """
    joins = first.measured_from or Touchdown(0.0, 1, 0)
    return record_gait(GHOST, gait, first.ends, joins.time, joins.foot + AHEAD)


def _title(name: str) -> str:
    """A name as it is written: in one line, and short enough to leave room for the bars."""
    text = " ".join(name.split())
    return text if len(text) <= LETTERS else "..." + text[3 - LETTERS :]


def _colours(names: Sequence[str]) -> list[Colour]:
    """Colours of the first walk and of the ghosts."""
    others = iter((*OTHERS, OPTIMUM))
    return [FIRST, *(OPTIMUM if name == GHOST else next(others) for name in names[1:])]


def drawn(walk: Recording, time: float) -> float:
    """E+ up to a time (J): drawn from a battery that cannot be recharged."""
    spent = walk.spent(time)
    return sum(spent[name] for name in DRAWN)


def spending(walk: Recording, time: float) -> dict[str, float]:
    """Where that energy went (J), by term of the ledger; the sum of all is what was drawn.

    "not recharged" is what the motor gives back. What pushes give counts as negative.
    """
    sums = walk.spent(time)
    spent = {name: sums[name] for name in ("idle", *LOSSES, "collision")}
    spent["not recharged"] = sums["electrical_positive"] - sums["electrical"]
    return spent | {"push": -sums["push"], "change of mechanical energy": sums["mechanical_change"]}
