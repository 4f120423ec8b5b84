"""What is to be tried next. Every plan lists only what the board does not have yet."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from scripts.studies.fronts.board import STEPS, Board
from scripts.studies.fronts.cells import Cell, Found, Place
from scripts.studies.fronts.pieces import Family, Join, Lead, Piece, Screen

#: Most turns of the pendulum per step, either way, of the families that are screened.
MOST_TURNS = 8

#: Random starts of a family in one round of screening: without turns and with some, of one step;
#: the same of more steps. A family with turns is given up if its first start becomes no gait.
SWINGS, WHIRLS, LONG_SWINGS, LONG_WHIRLS = 4, 2, 2, 1

#: By how much the pendulum's mean rate may exceed the highest that one-step gaits have shown.
RATE_MARGIN = 1.05

#: One-step gaits of a speed around whose turns per step the families of more steps are screened.
GUIDES = 2

#: Strides that are joined of one-step gaits at a speed: those that promise the least cost, if it is
#: less than this times the least known. Their steps' time may be wrong by this share.
JOINED, PROMISING, WRONG_TIME = 3, 1.05, 0.1

#: A gait is led on if it costs less than this times the highest cost of its seed's envelope within
#: `AROUND` (m/s): the front has narrow valleys, and gaits lead across them.
NEAR, AROUND = 1.3, 0.1

#: Most gaits of a cell that are led on; the cheapest one without turns is led on as well.
MOST_LED = 4


def one_step(seed: int, speeds: Iterable[float], board: Board, rounds: int = 1) -> list[Piece]:
    """Random starts of one-step gaits: no turns, and outwards to `MOST_TURNS` either way.

    A side is given up at the first number of turns whose first start becomes no gait.
    """
    pieces: list[Piece] = []
    for speed in speeds:
        cell = board.cell(Place(seed, speed, 1))
        pieces += _screen(cell, [0], SWINGS * rounds)
        for sign in (-1, 1):
            side = [sign * k for k in range(1, MOST_TURNS + 1)]
            end = next((i for i, k in enumerate(side) if _given_up(cell, k)), len(side))
            side = side[:end]
            pieces += _screen(cell, side, WHIRLS * rounds, outwards=True)
    return pieces


def more_steps(seed: int, speeds: Iterable[float], board: Board, rounds: int = 1) -> list[Piece]:
    """Random starts of gaits of more than one step, in the families of `families`."""
    pieces: list[Piece] = []
    for speed in speeds:
        for steps in STEPS[1:]:
            cell = board.cell(Place(seed, speed, steps))
            swinging, *whirling = families(board, cell.place)
            pieces += _screen(cell, [swinging], LONG_SWINGS * rounds)
            whirling = [turns for turns in whirling if not _given_up(cell, turns)]
            pieces += _screen(cell, whirling, LONG_WHIRLS * rounds)
    return pieces


def families(board: Board, place: Place) -> list[int]:
    """Turns per stride worth screening with more steps: none, and those near good one-step gaits.

    Near is less than one turn per step from one of the best `GUIDES` one-step families of the
    speed, at a mean rate that one-step gaits of the seed have shown at any speed.
    """
    steps, per_turn = place.steps, place.speed / (place.steps * board.params.step_length)
    slowest, fastest = _rates(board, place.seed)
    guides = [gait.turns for gait in distinct(board.cell(place._replace(steps=1)).gaits)][:GUIDES]
    near = {
        k
        for guide in guides
        for k in range(steps * (guide - 1) + 1, steps * (guide + 1))
        if slowest <= k * per_turn <= fastest and k != 0
    }
    return [0, *sorted(near, key=lambda k: (abs(k), k))]


def near_envelope(
    seed: int, speeds: Iterable[float], steps: Iterable[int], board: Board, rounds: int
) -> list[Piece]:
    """Random starts in the families that are near the seed's envelope, and without turns.

    Of one-step families one turn away from these there are fewer, as they may have been given up.
    """
    pieces: list[Piece] = []
    envelope = board.envelope(seed)
    for place in [Place(seed, speed, count) for speed in speeds for count in steps]:
        cell = board.cell(place)
        near = [
            gait.turns
            for gait in distinct(cell.gaits)
            if gait.cot <= ceiling(envelope, place.speed)
        ]
        others = [turns for turns in near if turns != 0]
        pieces += _screen(cell, [0], LONG_SWINGS * rounds)
        pieces += _screen(cell, others[:MOST_LED], WHIRLS * rounds)
        if place.steps == 1:
            beside = {k + i for k in near[:GUIDES] for i in (-1, 1)} - {0, *near}
            pieces += _screen(cell, sorted(beside), rounds)
    return pieces


def joints(seed: int, board: Board) -> list[Piece]:
    """Strides of a fast and a slow one-step gait, one of them perhaps twice.

    A stride of uneven steps can be cheaper than one of even steps: part of the time the wheel walks
    at a speed that suits its pendulum.
    """
    L, envelope = board.params.step_length, board.envelope(seed)
    ones = [
        gait
        for cell in board.of(seed)
        if cell.place.steps == 1
        for gait in worth_leading(cell, ceiling(envelope, cell.place.speed))
    ]
    pieces: list[Piece] = []
    for place in [Place(seed, speed, steps) for speed in board.grid for steps in STEPS[1:]]:
        promised: dict[tuple[int, ...], tuple[float, tuple[Found, ...]]] = {}
        for fast in ones:
            for slow in ones:
                for count in range(1, place.steps):
                    parts = (fast,) * count + (slow,) * (place.steps - count)
                    time, wanted = sum(L / p.speed for p in parts), place.steps * L / place.speed
                    if fast.speed <= slow.speed or abs(time / wanted - 1) > WRONG_TIME:
                        continue
                    cost = sum(part.cot for part in parts) / place.steps
                    kind = (count, fast.turns, slow.turns)
                    if kind not in promised or cost < promised[kind][0]:
                        promised[kind] = (cost, parts)
        least = envelope[place.speed].cot if place.speed in envelope else math.inf
        known = board.cell(place).led
        best = sorted(promised.values(), key=lambda pair: pair[0])[:JOINED]
        wanted_joints = [Join(place, parts) for cost, parts in best if cost <= PROMISING * least]
        pieces += [joint for joint in wanted_joints if joint.key not in known]
    return pieces


def leads(seed: int, board: Board) -> list[Piece]:
    """Gaits on or near the envelope, to be led to the neighbouring speeds, both ways."""
    pieces: list[Piece] = []
    envelope = board.envelope(seed)
    for cell in list(board.of(seed)):
        worth = worth_leading(cell, ceiling(envelope, cell.place.speed))
        i = board.grid.index(cell.place.speed)
        for speed in board.grid[max(i - 1, 0) : i] + board.grid[i + 1 : i + 2]:
            target = cell.place._replace(speed=speed)
            known = board.cell(target).led
            pieces += [Lead(target, gait) for gait in worth if gait.key not in known]
    return pieces


def worth_leading(cell: Cell, highest: float) -> list[Found]:
    """The gaits of a cell that cost at most `highest`, and its best without turns."""
    near = [gait for gait in distinct(cell.gaits) if gait.cot <= highest][:MOST_LED]
    swinging = [gait for gait in cell.gaits if gait.turns == 0][:1]
    return near + [gait for gait in swinging if gait not in near]


def ceiling(envelope: Mapping[float, Found], speed: float) -> float:
    """The cost below which a gait counts as near an envelope."""
    around = [gait.cot for v, gait in envelope.items() if abs(v - speed) <= AROUND]
    return NEAR * max(around, default=math.inf)


def distinct(gaits: Sequence[Found]) -> list[Found]:
    """The best gait of every family, best first."""
    best: dict[int, Found] = {}
    for gait in gaits:
        best.setdefault(gait.turns, gait)
    return list(best.values())


def _rates(board: Board, seed: int) -> tuple[float, float]:
    """Lowest and highest turns of the pendulum per second among one-step gaits, and a margin."""
    L = board.params.step_length
    shown = [g.turns * g.speed / L for cell in board.of(seed) for g in cell.gaits if g.steps == 1]
    return RATE_MARGIN * min([0.0, *shown]), RATE_MARGIN * max([0.0, *shown])


def _screen(
    cell: Cell, families: Sequence[int], starts: int, *, outwards: bool = False
) -> list[Piece]:
    """The starts that these families still lack up to a number; none if they have them."""
    lacking = [
        Family(k, cell.tried(k), starts - cell.tried(k)) for k in families if cell.tried(k) < starts
    ]
    if outwards and lacking:
        return [Screen(cell.place, tuple(lacking), outwards)]
    return [Screen(cell.place, (family,)) for family in lacking]


def _given_up(cell: Cell, turns: int) -> bool:
    """Whether a family with turns was given up at its first random start."""
    return turns != 0 and cell.starts.get(turns) == (1, 0)
