"""A gait of the search solved on a fine mesh and verified, and its files."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any, NamedTuple

from rimless_gym.params import WheelParams
from scripts.studies.fronts.cells import Found
from scripts.studies.fronts.pieces import elements_for
from trajopt.files import write_text
from trajopt.gaits.periodic import DEGREE, ELEMENTS, finished
from trajopt.gaits.problem import CONTROL_DEGREE, gait_problem
from trajopt.gaits.solution import GaitFileError, Solution
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.solve import WARM_BARRIER, solve

#: Refinements of the fine mesh at most and their tolerance: at first, and where the gait then fails
#: its verification.
REFINED: tuple[dict[str, Any], ...] = ({"passes": 4}, {"passes": 6, "tolerance": 1e-9})


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


def keep(folder: Path, each: Polished) -> None:
    """Write what became of a gait."""
    note, path = _files(folder, each.gait)
    if each.solution is not None:
        each.solution.save(path)
    header: dict[str, Any] = {"failure": each.failure, "seconds": each.seconds}
    write_text(note, json.dumps(header) + "\n")


def kept(folder: Path, gait: Found) -> Polished | None:
    """What became of a gait earlier; None if it is not known, or its file was damaged."""
    note, path = _files(folder, gait)
    try:
        header = json.loads(note.read_text())
        solution = Solution.load(path) if path.exists() else None
        return Polished(gait, solution, header["failure"], header["seconds"])
    except (FileNotFoundError, GaitFileError, ValueError, KeyError, TypeError):
        return None
