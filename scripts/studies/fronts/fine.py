"""The search's gaits on fine meshes, best first: only those that pass verification are the front.

The search's mesh is coarse, and some gaits look cheaper on it than they are. So at every speed the
gaits are solved finely in the order of their cost on the search's mesh, until the next one could
not be cheaper than the best that is verified. Where none is, or where it costs more than the search
promised, verified gaits of the neighbouring speeds are led there on fine meshes.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

from scripts.studies.fronts.agreement import AGREEMENT
from scripts.studies.fronts.board import STEPS, Board
from scripts.studies.fronts.campaign import LAST, SEEDS
from scripts.studies.fronts.cells import Found, Place
from scripts.studies.fronts.crew import Crew, bar, while_affordable
from scripts.studies.fronts.plans import distinct
from scripts.studies.fronts.polish import Polished, keep, kept, polish

#: Gaits are near the envelope if they cost less than this times it; at most so many of a speed.
NEAR_FRONT, MOST = 1.25, 3

#: A stride that costs as much as a shorter one that it may repeat (relative) is not solved.
REPEATED = 2e-3

#: Most gaits of one speed that are solved finely in search of its best, and that are led there.
TRIED, LED = 5, 6


class Fine:
    """Gaits on fine meshes, kept in files.

    Attributes:
        board: of the search.
        folder: of the files.
        crew: that does the work.
        budget: of computing time, over all processes, the search included (s).
        done: what became of the gaits so far, by their key.
    """

    def __init__(self, board: Board, folder: Path, crew: Crew, budget: float) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.board, self.folder, self.crew, self.budget = board, folder, crew, budget
        self.done: dict[str, Polished] = {}

    def solve(self, title: str, wanted: Iterable[Found]) -> int:
        """Solve gaits finely as long as the budget lasts; how many were new."""
        before = len(self.done)
        unsolved = []
        for gait in wanted:
            known = kept(self.folder, gait)
            if known is None:
                unsolved.append(gait)
            else:
                self.done[gait.key] = known
        if unsolved:
            work = while_affordable(unsolved, self._affordable)
            with bar(len(unsolved), title) as progress:
                for gait, each in self.crew(partial(polish, self.board.params), work):
                    keep(self.folder, each)
                    self.done[gait.key] = each
                    progress.update()
        return len(self.done) - before

    def least(self, speed: float) -> float:
        """The cost of the best verified gait at a speed; infinite if there is none."""
        costs = [
            each.solution.cot
            for each in self.done.values()
            if each.gait.speed == speed and each.solution is not None and not each.failure
        ]
        return min(costs, default=math.inf)

    def _affordable(self) -> bool:
        return self.board.seconds + sum(each.seconds for each in self.done.values()) < self.budget


def polished(board: Board, folder: Path, crew: Crew, budget: float) -> list[Polished]:
    """The front on fine meshes, and the other gaits that are worth shipping, in that order.

    Args:
        board: of the search.
        folder: of finished gaits; those that are there are not solved again.
        crew: that does the work.
        budget: of computing time, over all processes, the search included (s).
    """
    fine = Fine(board, folder, crew, budget)
    _until_nothing_is_new(fine, "fine meshes: the front", rivals)
    _until_nothing_is_new(fine, "fine meshes: led from neighbours", neighbours)
    fine.solve("fine meshes: other gaits", others(board))
    return list(fine.done.values())


def _until_nothing_is_new(fine: Fine, title: str, wanted: Callable[[Fine], list[Found]]) -> None:
    while fine.solve(title, wanted(fine)):
        pass


def rivals(fine: Fine) -> list[Found]:
    """At every speed the next gait of the search, if it promises to be the cheapest."""
    wanted = []
    for speed in sorted(fine.board.envelope(LAST)):
        ranked = different(fine.board, speed)[:TRIED]
        new = [
            gait for gait in ranked if gait.key not in fine.done and gait.cot < fine.least(speed)
        ]
        wanted += new[:1]
    return wanted


def neighbours(fine: Fine) -> list[Found]:
    """Verified gaits to lead to a neighbouring speed that has none, or a dearer one than promised.

    Each stands at the new speed with the cost and the motion of the old one.
    """
    promised = {speed: gait.cot for speed, gait in fine.board.envelope(LAST).items()}
    speeds, wanted = sorted(promised), []
    for i, speed in enumerate(speeds):
        if fine.least(speed) <= (1 + AGREEMENT) * promised[speed]:
            continue
        beside = {*speeds[max(i - 1, 0) : i], *speeds[i + 1 : i + 2]}
        verified = [
            each
            for each in fine.done.values()
            if each.gait.speed in beside and each.solution is not None and not each.failure
        ]
        verified.sort(key=lambda each: each.solution.cot if each.solution else math.inf)
        leads = [_at(speed, each) for each in verified[:LED]]
        wanted += [lead for lead in leads if lead.key not in fine.done]
    return wanted


def _at(speed: float, each: Polished) -> Found:
    assert each.solution is not None
    origin = each.gait.origin.split("; ")[0]
    return dataclasses.replace(
        each.gait,
        speed=speed,
        cot=each.solution.cot,
        phases=each.solution.phases,
        origin=f"{origin}; led from {each.gait.speed:g} m/s on a fine mesh",
    )


def others(board: Board) -> list[Found]:
    """Gaits worth shipping beside the front.

    At the speeds that were screened with random starts the best of each number of steps and the
    best without turns; at all speeds those near the envelope.
    """
    later: list[Found] = []
    near: list[Found] = []
    for speed, best in sorted(board.envelope(LAST).items()):
        gaits = different(board, speed)
        if any(board.cell(Place(seed, speed, 1)).starts for seed in SEEDS):
            kinds = [[g for g in gaits if g.steps == steps] for steps in STEPS]
            kinds.append([g for g in gaits if g.turns == 0])
            later += [kind[0] for kind in kinds if kind]
        near += [gait for gait in gaits if gait.cot <= NEAR_FRONT * best.cot][:MOST]
    return list({gait.key: gait for gait in (*later, *near)}.values())


def different(board: Board, speed: float) -> list[Found]:
    """The best gait of every family of a speed, best first, without repeated shorter strides."""
    gaits: list[Found] = []
    for steps in STEPS:
        for gait in distinct(board.cell(Place(LAST, speed, steps)).gaits):
            if not any(_repeats(gait, shorter) for shorter in gaits):
                gaits.append(gait)
    return sorted(gaits, key=lambda g: (g.cot, g.steps))


def _repeats(gait: Found, shorter: Found) -> bool:
    times, rest = divmod(gait.steps, shorter.steps)
    same = rest == 0 and gait.turns == times * shorter.turns
    return same and gait.cot > (1 - REPEATED) * shorter.cot
