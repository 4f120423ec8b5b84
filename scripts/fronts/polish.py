"""The search's gaits solved on fine meshes and verified: only these count as the front."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rimless_gym.params import WheelParams
from scripts.fronts.board import STEPS, Board
from scripts.fronts.campaign import LAST, SEEDS
from scripts.fronts.cells import Found, Place
from scripts.fronts.crew import Crew, bar, while_affordable
from scripts.fronts.pieces import elements_for
from scripts.fronts.plans import distinct
from trajopt.files import write_text
from trajopt.gaits.finishing import finished
from trajopt.gaits.gait_file import GaitFileError
from trajopt.gaits.gait_problem import gait_problem
from trajopt.gaits.periodic import DEGREE, ELEMENTS
from trajopt.gaits.solution import Solution
from trajopt.gaits.stance import CONTROL_DEGREE
from trajopt.ocp.solving.runs import WARM_BARRIER
from trajopt.ocp.solving.solve import solve
from trajopt.ocp.transcribe.mesh import Mesh

#: Gaits are near the envelope if they cost less than this times it; at most so many of a speed.
NEAR_FRONT, MOST = 1.25, 3

#: Refinements of the fine mesh at most and their tolerance: at first, and where the gait then fails
#: its verification.
REFINED: tuple[dict[str, Any], ...] = ({"passes": 4}, {"passes": 6, "tolerance": 1e-9})

#: A stride that costs as much as a shorter one that it may repeat (relative) is not solved.
REPEATED = 2e-3


class Polished(NamedTuple):
    """What became of a gait of the search.

    Attributes:
        gait: of the search.
        solution: verified, or not; None where the fine mesh has none.
        failure: why it does not count; empty if it does.
        seconds: of computing.
    """

    gait: Found
    solution: Solution | None
    failure: str
    seconds: float


def candidates(board: Board) -> list[Found]:
    """The gaits worth solving finely, the most important first.

    First the envelope; then at every speed the best of each number of steps, the best without
    turns, and those near the envelope. The best of each number of steps and without turns are
    wanted at the speeds that were screened with random starts, and near the envelope at all.
    """
    first: list[Found] = []
    later: list[Found] = []
    near: list[Found] = []
    for speed, best in sorted(board.envelope(LAST).items()):
        gaits = _different(board, speed)
        first += gaits[:1]
        if any(board.cell(Place(seed, speed, 1)).starts for seed in SEEDS):
            kinds = [[g for g in gaits if g.steps == steps] for steps in STEPS]
            kinds.append([g for g in gaits if g.turns == 0])
            later += [kind[0] for kind in kinds if kind]
        near += [gait for gait in gaits if gait.cot <= NEAR_FRONT * best.cot][:MOST]
    return list({gait.key: gait for gait in (*first, *later, *near)}.values())


def _different(board: Board, speed: float) -> list[Found]:
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


def polished(
    gaits: Iterable[Found], board: Board, folder: Path, crew: Crew, budget: float
) -> list[Polished]:
    """The gaits solved finely and verified, as long as the budget lasts.

    Args:
        gaits: of the search, the most important first.
        board: of the search.
        folder: of finished gaits; those that are there are not solved again.
        crew: that does the work.
        budget: of computing time, over all processes, the search included (s).
    """
    folder.mkdir(parents=True, exist_ok=True)
    kept = {gait.key: _kept(folder, gait) for gait in gaits}
    done = [each for each in kept.values() if each is not None]
    wanted = [gait for gait in gaits if kept[gait.key] is None]

    def affordable() -> bool:
        return board.seconds + sum(each.seconds for each in done) < budget

    work = while_affordable(wanted, affordable)
    with bar(len(wanted), "fine meshes and verification") as progress:
        for _, each in crew(partial(polish, board.params), work):
            _keep(folder, each)
            done.append(each)
            progress.update()
    order = {gait.key: i for i, gait in enumerate(gaits)}
    return sorted(done, key=lambda each: order[each.gait.key])


def polish(params: WheelParams, gait: Found) -> Polished:
    """One gait solved finely and verified."""
    begin = time.process_time()
    problem = gait_problem(params, speed=gait.speed, steps=gait.steps, theta_turns=gait.turns)
    duration = gait.steps * params.step_length / gait.speed
    elements = [max(ELEMENTS, n) for n in elements_for(gait.phases, duration)]
    mesh = Mesh.uniform(problem, elements, DEGREE, control_degree=CONTROL_DEGREE)
    settings = {"speed": gait.speed, "found_by": gait.origin, "cot_of_search": gait.cot}
    phases, solution, failure = gait.phases, None, ""
    for refined in REFINED:
        found = solve(problem, phases, mesh, verify=False, mu_init=WARM_BARRIER, **refined)
        if not found.succeeded:
            failure = failure or f"no gait on a fine mesh: {found.status}"
            break
        solution = finished(params, found, gait.turns, False, (), settings)
        failure = "; ".join(solution.verification.failures)
        if not failure:
            break
        phases, mesh = found.phases, found.mesh
    return Polished(gait, solution, failure, time.process_time() - begin)


def _files(folder: Path, gait: Found) -> tuple[Path, Path]:
    name = f"{gait.steps}_steps_k{gait.turns}_{gait.speed:.4f}_{gait.cot:.6g}"
    return folder / f"{name}.json", folder / f"{name}.npz"


def _keep(folder: Path, each: Polished) -> None:
    note, path = _files(folder, each.gait)
    if each.solution is not None:
        each.solution.save(path)
    header: dict[str, Any] = {"failure": each.failure, "seconds": each.seconds}
    write_text(note, json.dumps(header) + "\n")


def _kept(folder: Path, gait: Found) -> Polished | None:
    """What became of a gait earlier; None if it is not known, or its file was damaged."""
    note, path = _files(folder, gait)
    try:
        header = json.loads(note.read_text())
        solution = Solution.load(path) if path.exists() else None
        return Polished(gait, solution, header["failure"], header["seconds"])
    except (FileNotFoundError, GaitFileError, ValueError, KeyError):
        return None
