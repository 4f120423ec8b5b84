"""The search's result as JSON: the front, who found each gait, and what the search did."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from rimless_gym.params import WheelParams
from scripts.studies.fronts.agreement import AGREEMENT, disagreements
from scripts.studies.fronts.board import Board
from scripts.studies.fronts.campaign import LAST, SEEDS, Sweep, costs
from scripts.studies.fronts.polish import Polished
from trajopt.files import jsonable
from trajopt.gaits.fronts import CotFront
from trajopt.gaits.periodic import NoGaitError
from trajopt.gaits.solution import Solution
from trajopt.provenance import provenance

#: Where a gait came from that was shipped before and that the search did not beat.
SHIPPED = "shipped before this search"


def chosen(done: Iterable[Polished], shipped: Iterable[Solution]) -> list[Solution]:
    """The gaits to ship: the best verified one of every speed, number of steps and of turns.

    Args:
        done: the search's gaits on fine meshes.
        shipped: gaits of the same machine that were shipped before; one is kept unless the search
            found a cheaper one at its speed, steps and turns.

    Raises:
        NoGaitError: there is none at all.
    """
    passed = [each.solution for each in done if each.solution is not None and not each.failure]
    best: dict[tuple[float, int, int], Solution] = {}
    for gait in (*passed, *shipped):
        place = round(gait.speed, 4), gait.steps, gait.theta_turns
        if place not in best or gait.cot < best[place].cot:
            best[place] = gait
    if not best:
        raise NoGaitError(
            "no gait passed its verification yet: give the same command more --minutes"
        )
    return [best[place] for place in sorted(best)]


def record(
    name: str,
    board: Board,
    gaits: Sequence[Solution],
    done: Sequence[Polished],
    sweeps: Sequence[Sweep],
    minutes: float,
    workers: int,
) -> dict[str, Any]:
    """Everything as plain JSON values.

    Args:
        name: of the machine.
        board: of the search.
        gaits: that are shipped.
        done: the search's gaits on fine meshes, the failed ones included.
        sweeps: the last sweeps.
        minutes: budget of time (min).
        workers: processes.
    """
    by_seed = [costs(board, seed) for seed in SEEDS]
    gaps = disagreements(*by_seed)
    front = CotFront(tuple(gaits))
    rows = [
        _row(gait, [seed.get(round(gait.speed, 4)) for seed in by_seed]) | {"rest": rest}
        for gait, rest in zip(front.envelope, _rests(front), strict=True)
    ]
    missing = sorted(set(costs(board, LAST)) - {row["speed"] for row in rows})
    polishing = sum(each.seconds for each in done)
    return dict(
        jsonable(
            {
                "machine": name,
                "params": board.params.to_dict(),
                "front": rows,
                "other_gaits": [
                    _row(gait, []) for gait in gaits if not any(gait is g for g in front.envelope)
                ],
                "speeds_without_verified_gait": missing,
                "failed_on_fine_meshes": [
                    {"gait": each.gait.key, "why": each.failure} for each in done if each.failure
                ],
                "seeds": [_effort(board, seed) for seed in SEEDS],
                "last_sweep": _effort(board, LAST),
                "last_sweeps": [sweep._asdict() for sweep in sweeps],
                "agreement": {
                    "wanted": AGREEMENT,
                    "largest_difference": max(gaps.values(), default=math.inf),
                    "differences": {f"{speed:g}": gap for speed, gap in gaps.items()},
                },
                "minutes": {
                    "budget": minutes,
                    "workers": workers,
                    "search_of_one_core": board.seconds / 60,
                    "fine_meshes_of_one_core": polishing / 60,
                },
                "provenance": provenance(),
            }
        )
    )


def _row(gait: Solution, seeds: Sequence[float | None]) -> dict[str, Any]:
    v = gait.verification
    return {
        "speed": round(gait.speed, 4),
        "steps": gait.steps,
        "turns": gait.theta_turns,
        "cot": gait.cot,
        "cot_of_search": gait.provenance.get("cot_of_search"),
        "cot_of_seeds": list(seeds),
        "found_by": gait.provenance.get("found_by", SHIPPED),
        "friction_demand": max(v.max_friction_demand, v.max_impulse_friction_demand),
        "min_normal_force_over_weight": v.min_normal_force_over_weight,
        "clearance": v.clearance,
    }


def _rests(front: CotFront) -> list[dict[str, float] | None]:
    return [None if rest is None else rest._asdict() for rest in front.rests]


def _effort(board: Board, seed: int) -> dict[str, Any]:
    cells = list(board.of(seed))
    counts = [count for cell in cells for count in cell.starts.values()]
    return {
        "seed": seed,
        "random_starts": sum(tried for tried, _ in counts),
        "became_gaits": sum(good for _, good in counts),
        "led_or_joined": sum(len(cell.led) for cell in cells),
        "minutes_of_one_core": sum(cell.seconds for cell in cells) / 60,
    }


def same_machine(gaits: Iterable[Solution], params: WheelParams) -> list[Solution]:
    """The gaits of a machine with E+ as their objective."""
    return [gait for gait in gaits if gait.params == params and not gait.regeneration]
