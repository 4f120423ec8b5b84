"""The study `thesis`: solve the thesis's six experiments, compare them with what it prints."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.figure import Figure

from agents.cli.options import MaybeCount, MaybePath
from scripts.studies.documents import markdown
from scripts.studies.thesis.cases import EXPERIMENTS, Key, case_of, needed
from scripts.studies.thesis.solve import SolvedCase, sampled_times, solved
from trajopt.pool import run
from trajopt.store import write_text

#: The solutions that docs/thesis.md shows, by file name: experiment and variant.
SHOWN: dict[str, Key] = {
    "experiment_1": (1, "cost 4.4"),
    "experiment_2": (2, "|theta'| <= 8 pi at the end"),
    "experiment_3": (3, "cost 4.6, m2 = 1 kg"),
    "experiment_4": (4, "cost 4.6, m2 = 1 kg"),
    "experiment_5": (5, "plastic, phi'(0) <= 10"),
    "experiment_6": (6, "elastic, step 2"),
}

#: Columns of the table: heading and format.
COLUMNS = {
    "": "{experiment}",
    "variant": "{variant}",
    "cost, thesis": "{thesis_cost:.6f}",
    "cost": "{cost:.6f}",
    "energy, thesis (J)": "{thesis_energy_J:.6f}",
    "energy (J)": "{energy_J:.6f}",
    "t_f (s)": "{final_time:.4f}",
    "state error": "{max_state_error:.0e}",
    "touchdown error (s)": "{touchdown_time_error:.0e}",
    "least Fy / weight": "{min_normal_force_over_weight:.2f}",
    "starts to the best": "{starts_reaching_best} of {starts}",
}

MARKS = markdown.marks("thesis", ("table",))


def thesis(
    *,
    experiment: Literal[1, 2, 3, 4, 5, 6] | None = None,
    out: Path = Path("runs/thesis"),
    workers: MaybeCount = None,
    docs: MaybePath = None,
) -> int:
    """Solve the thesis's six experiments; the exit status is 1 if a case has not converged.

    Args:
        experiment: one of them; all by default.
        out: folder for results.json and the figures.
        workers: processes; by default one for every core.
        docs: a page, docs/thesis.md, to put the table and the figures into.
    """
    begin = time.perf_counter()
    solutions = solve_all([experiment] if experiment else list(EXPERIMENTS), workers)
    rows = [row for solution in solutions for row in solution.rows()]
    write(out, solutions, rows)
    if docs:
        write(docs.parent / "figures" / "thesis", solutions, rows)
        markdown.refresh(docs, MARKS, sections(rows))
    for solution in solutions:
        print(_line(solution))
    print(f"{len(solutions)} problems in {time.perf_counter() - begin:.0f} s: see {out}")
    return 0 if all(solution.converged for solution in solutions) else 1


def solve_all(numbers: Sequence[int], workers: int | None = None) -> list[SolvedCase]:
    """The cases of some experiments, in order."""
    cases, done = needed(numbers), dict[Key, SolvedCase]()
    while waiting := [case for case in cases if case.key not in done]:
        tasks = [
            (case.key, done[case.after.key] if case.after else None)
            for case in waiting
            if case.after is None or case.after.key in done
        ]
        for (key, _), solution in run(_solved, tasks, workers, progress="problems"):
            done[key] = solution
    return [done[case.key] for case in cases if case.experiment in numbers]


def _solved(task: tuple[Key, SolvedCase | None]) -> SolvedCase:
    """Solve a case given by its key, after the one that it continues."""
    key, before = task
    return solved(case_of(key), before)


def write(folder: Path, solutions: Sequence[SolvedCase], rows: Sequence[dict[str, Any]]) -> None:
    """Write results.json and the figures into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "results.json", json.dumps(rows, indent=1, allow_nan=False) + "\n")
    for name, key in SHOWN.items():
        for solution in solutions:
            if solution.key == key:
                figure(solution).savefig(folder / f"{name}.png", dpi=90)


def figure(solution: SolvedCase) -> Figure:
    """Angles, rates and voltage; dashed: simulated."""
    drawn = Figure(figsize=(11, 2.6), layout="constrained")
    angles, rates, volts = drawn.subplots(1, 3)
    played, begin = solution.simulated, 0.0
    jumps = np.flatnonzero(np.diff(played.times) == 0.0) + 1  # no line is drawn over a jump
    dashed_times = np.insert(played.times, jumps, np.nan)
    dashed = np.insert(played.states, jumps, np.nan, axis=0)
    lines = ((angles, "C0", "φ"), (angles, "C1", "θ"), (rates, "C0", "φ'"), (rates, "C1", "θ'"))
    for column, (panel, colour, name) in enumerate(lines):
        panel.plot(dashed_times, dashed[:, column] / math.pi, "--", color="k", lw=0.8)
        panel.plot([], [], color=colour, label=name)
    for phase in solution.motion:
        t = sampled_times(phase)
        for column, (panel, colour, _) in enumerate(lines):
            panel.plot(begin + t, phase.state(t)[:, column] / math.pi, color=colour)
        volts.plot(begin + t, phase.control(t)[:, 0], color="C2")
        begin += phase.duration
    for panel, unit in ((angles, "rad"), (rates, "rad/s")):
        panel.set(xlabel="t (s)", ylabel=f"π {unit}")
        panel.legend(frameon=False)
    volts.set(xlabel="t (s)", ylabel="voltage (V)", title=f"cost {solution.extremal.cost:.6f}")
    return drawn


def sections(rows: Sequence[dict[str, Any]]) -> dict[str, str]:
    """The tables of docs/thesis.md, by their marks."""
    named = [
        row | ({} if row["converged"] else {"variant": f"{row['variant']} (not converged)"})
        for row in rows
    ]
    return {"table": markdown.formatted(COLUMNS, named) + "\n"}


def _line(solution: SolvedCase) -> str:
    printed = solution.case.printed[0]
    thesis = "-" if printed.cost is None else f"{printed.cost:.6f}"
    outcome = "converged" if solution.converged else "NOT CONVERGED"
    starts = f"{solution.reaching}/{solution.case.effort.starts} starts"
    return (
        f"{solution.key[0]}  {printed.variant:<44} cost {solution.extremal.cost:12.6f} "
        f"(thesis {thesis:>12})  {starts:<12}  {outcome}"
    )
