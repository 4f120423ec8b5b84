"""The search, from its first random start to two seeds that agree and a last sweep.

Everything it knows is on the board, whose cells are files. After an interruption it passes through
the same stages again, and finds that what was done need not be done again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from scripts.studies.fronts import plans
from scripts.studies.fronts.agreement import AGREEMENT, disagreements, midpoints
from scripts.studies.fronts.board import STEPS, Board
from scripts.studies.fronts.cells import Place
from scripts.studies.fronts.crew import Crew, bar, while_affordable
from scripts.studies.fronts.pieces import Lead, Piece, attempts
from trajopt.gaits.periodic import NoGaitError
from trajopt.gaits.problem import fastest_walk

#: The two independent seeds, and that of the last sweep, which begins with what both have found.
SEEDS, LAST = (0, 1), 2

#: Longest step (s): a slower wheel stands balanced on one leg, for as long as one likes.
LONGEST_STEP = 5.0

#: The upper end of the walks is reached where so many speeds of the grid in a row have none.
EMPTY = 2

#: Speeds that are screened at a time on the way up.
BATCH = 4

#: Every so many speeds of the grid one is screened with random starts; to the others gaits are led.
SCREENED = 2

#: The shortest distance between speeds is the grid's spacing divided by this.
FINEST = 4

#: Shares of the budget at which the two seeds' search ends, and the last sweeps.
AGREED, SEARCHED = 0.55, 0.7

#: Rounds of random starts of one-step gaits near the envelope, beyond the first screening.
MORE_STARTS = 3

#: Most rounds of more random starts where the two seeds disagree, and most last sweeps.
ROUNDS, SWEEPS = 20, 3


class Sweep(NamedTuple):
    """A last sweep.

    Attributes:
        gain: by how much it beat both seeds, at most (relative); 0 if it found nothing better.
        speed: where that was (m/s).
        complete: whether it ended before the budget did.
    """

    gain: float
    speed: float
    complete: bool


def searched(board: Board, spacing: float, budget: float, crew: Crew) -> tuple[Sweep, ...]:
    """Search until two seeds agree and a sweep finds nothing better, or the budget is used up.

    Args:
        board: where everything is kept; it may hold an earlier, interrupted search.
        spacing: of the grid of speeds (m/s); more are put between where the front is steep.
        budget: of computing time, over all processes (s).
        crew: that does the work.

    Returns:
        The last sweeps, in order.

    Raises:
        NoGaitError: no gait was found at any speed.
    """
    search = _Search(board, spacing, budget, crew)
    search.two_seeds()
    return search.last_sweeps()


def costs(board: Board, *seeds: int) -> dict[float, float]:
    """The least cost of transport that any of these seeds found, by speed (m/s)."""
    least: dict[float, float] = {}
    for seed in seeds:
        for speed, gait in board.envelope(seed).items():
            least[speed] = min(gait.cot, least.get(speed, math.inf))
    return dict(sorted(least.items()))


def disputed(board: Board) -> list[float]:
    """Speeds at which the two seeds disagree by more than `AGREEMENT`."""
    gaps = disagreements(*(costs(board, seed) for seed in SEEDS))
    return [speed for speed, gap in gaps.items() if gap > AGREEMENT]


class _Search:
    """The stages of a search, which share its board, budget and crew."""

    def __init__(self, board: Board, spacing: float, budget: float, crew: Crew) -> None:
        self.board, self.spacing, self.budget, self.crew = board, spacing, budget, crew

    def two_seeds(self) -> None:
        """Both seeds, each on its own, until they agree."""
        screened = self._one_step()
        for seed in SEEDS:
            title = f"seed {seed}: 1 step near the envelope"
            self._starts(seed, title, screened, STEPS[:1], MORE_STARTS)
        self._settle(AGREED, SEEDS)
        self._join(AGREED, SEEDS)
        for seed in SEEDS:
            plan = partial(plans.more_steps, seed, screened, self.board)
            self._run(AGREED, f"seed {seed}: 2 and 3 steps", plan)
        self._settle(AGREED, SEEDS)
        for number in range(1, ROUNDS + 1):
            speeds = disputed(self.board)
            if not speeds or not self._affordable(AGREED):
                return
            for seed in SEEDS:
                title = f"seed {seed}: {len(speeds)} disputed speeds, round {number}"
                self._starts(seed, title, speeds, STEPS, MORE_STARTS + number)
                plan = partial(plans.more_steps, seed, speeds, self.board, number)
                self._run(AGREED, title, plan)
            self._join(AGREED, SEEDS)
            self._settle(AGREED, SEEDS)

    def _starts(
        self, seed: int, title: str, speeds: Sequence[float], steps: Sequence[int], rounds: int
    ) -> None:
        """Random starts near a seed's envelope."""
        share = SEARCHED if seed == LAST else AGREED
        plan = partial(plans.near_envelope, seed, speeds, steps, self.board, rounds)
        self._run(share, title, plan)

    def _join(self, share: float, seeds: Sequence[int]) -> None:
        """Join one-step gaits to strides of more steps."""
        for seed in seeds:
            self._run(share, f"seed {seed}: joined steps", partial(plans.joints, seed, self.board))

    def last_sweeps(self) -> tuple[Sweep, ...]:
        """Fresh starts and continuation from what both seeds found, until nothing better comes."""
        self._unite()
        sweeps: list[Sweep] = []
        for number in range(1, SWEEPS + 1):
            before = costs(self.board, LAST if sweeps else SEEDS[0], *SEEDS)
            self._join(SEARCHED, (LAST,))
            self._starts(LAST, f"last sweep {number}", self.board.grid, STEPS, number)
            self._settle(SEARCHED, (LAST,))
            after = costs(self.board, LAST)
            gains = {speed: 1 - after[speed] / before.get(speed, math.inf) for speed in after}
            speed = max(gains, key=lambda v: gains[v])
            sweeps.append(Sweep(gains[speed], speed, self._affordable(SEARCHED)))
            if sweeps[-1].gain <= AGREEMENT or not sweeps[-1].complete:
                break
        return tuple(sweeps)

    def _one_step(self) -> list[float]:
        """Screen one-step gaits from slow to fast; the speeds that were screened."""
        tops = []
        for seed in SEEDS:
            speeds: list[float] = []
            while not self._above(seed, speeds) and self._affordable(AGREED):
                speeds = self._multiples(len(speeds) + BATCH)
                plan = partial(plans.one_step, seed, speeds, self.board)
                self._run(AGREED, f"seed {seed}: 1 step, to {speeds[-1]:g} m/s", plan)
            tops.append(len(speeds))
        screened = self._multiples(max(tops))
        for seed in SEEDS:
            plan = partial(plans.one_step, seed, screened, self.board)
            self._run(AGREED, f"seed {seed}: 1 step", plan)
        found = costs(self.board, *SEEDS)
        if not found:
            raise NoGaitError(
                f"no gait of one step was found from {screened[0]:g} to {screened[-1]:g} m/s "
                f"within {self.budget / 60:.3g} minutes of computing: give the search more time, "
                "or the machine a higher voltage limit or friction"
            )
        walks = [v for v in screened if min(found) <= v <= max(found)]
        between = [v + i * self.spacing for v in walks for i in range(1, SCREENED)]
        self.board.widen([*screened, *between])
        self._settle(AGREED, SEEDS)
        return walks

    def _multiples(self, count: int) -> list[float]:
        """So many of the speeds that are screened, from the slowest up."""
        first = math.ceil(self.board.params.step_length / LONGEST_STEP / self.spacing - 1e-9)
        fastest = fastest_walk(self.board.params)
        speeds = [round((first + SCREENED * i) * self.spacing, 4) for i in range(count)]
        return [speed for speed in speeds if speed <= fastest]

    def _above(self, seed: int, speeds: Sequence[float]) -> bool:
        """Whether these speeds reach beyond the fastest walk."""
        walked = [self.board.cell(Place(seed, v, 1)).best is not None for v in speeds]
        at_end = bool(speeds) and speeds == self._multiples(len(speeds) + 1)
        return at_end or (any(walked) and not any(walked[-EMPTY:]))

    def _settle(self, share: float, seeds: Sequence[int]) -> None:
        """Lead gaits on, with more speeds where the front is steep, until nothing is left."""
        refining = LAST not in seeds  # new speeds are for both seeds
        for number in range(1, 100):
            wanted = partial(self._leads, seeds)
            if not self._affordable(share):
                return
            if self._run(share, f"continuation, round {number}", wanted):
                continue
            steep = midpoints(self.board.grid, costs(self.board, *SEEDS), self.spacing / FINEST)
            if not (refining and self.board.widen(steep)):
                return

    def _leads(self, seeds: Sequence[int]) -> list[Piece]:
        return [piece for seed in seeds for piece in plans.leads(seed, self.board)]

    def _unite(self) -> None:
        """Give the last sweep's cells what both seeds found and led on."""
        for speed in self.board.grid:
            for steps in STEPS:
                cell = self.board.cell(Place(LAST, speed, steps))
                united, led = cell, cell.led
                for seed in SEEDS:
                    known = self.board.cell(Place(seed, speed, steps))
                    led |= known.led
                    for gait in known.gaits:
                        united = united.with_gait(gait)
                united = united.having_led(led)
                if united != cell:
                    self.board.keep(united)

    def _run(self, share: float, title: str, plan: Callable[[], list[Piece]]) -> int:
        """Do what a plan lists, while the budget's share lasts; how many pieces it lists."""
        pieces = plan()
        if not pieces:
            return 0
        affordable = while_affordable(pieces, partial(self._affordable, share))
        with bar(len(pieces), title) as progress:
            for piece, made in self.crew(partial(attempts, self.board.params), affordable):
                source = piece.gait.speed if isinstance(piece, Lead) else None
                self.board.add(piece.place, made, source)
                spent = f"{self.board.seconds / 60:.1f} of {self.budget / 60:.4g} min"
                progress.set_postfix_str(spent, refresh=False)
                progress.update()
        return len(pieces)

    def _affordable(self, share: float) -> bool:
        return self.board.seconds < share * self.budget
