"""Solve the thesis's six experiments; write results.json and their figures.

With --prototype, find out instead whether the machine as built can walk. That takes half an hour.
After an interruption, the same command continues.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from scripts.studies.documents import markdown
from scripts.studies.thesis import prototype
from scripts.studies.thesis.cases import EXPERIMENTS, Key, case_of, needed
from scripts.studies.thesis.solve import Solved, of_durations, sampled_times, simulated, solved
from trajopt.ocp.extremal import Extremal, ExtremalFileError
from trajopt.pool import run
from trajopt.store import Store, provenance, write_text

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

#: Fields of `Solved` about the search, which the store holds beside the solution.
SEARCH = ("optima", "failed", "reaching")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 if every case converged, 1 if not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--experiment", type=int, choices=EXPERIMENTS, help="one; all by default")
    parser.add_argument("--prototype", action="store_true", help="the machine as built")
    parser.add_argument("--out", type=Path, default=Path("runs/thesis"), help="folder to write to")
    parser.add_argument("--workers", type=int, help="processes")
    parser.add_argument(
        "--docs", type=Path, help="docs/thesis.md, to put the table and figures into"
    )
    options = parser.parse_args(arguments)
    if options.prototype:
        prototype.study(options.out / "prototype", options.workers, options.docs)
        return 0
    numbers = [options.experiment] if options.experiment else list(EXPERIMENTS)
    begin = time.perf_counter()
    solutions = solve_all(numbers, options.out, options.workers)
    rows = [row for solution in solutions for row in solution.rows()]
    write(options.out, solutions, rows)
    if options.docs:
        write(options.docs.parent / "figures" / "thesis", solutions, rows)
        markdown.refresh(options.docs, MARKS, sections(rows))
    for solution in solutions:
        print(_line(solution))
    print(f"{len(solutions)} problems in {time.perf_counter() - begin:.0f} s: see {options.out}")
    return 0 if all(solution.converged for solution in solutions) else 1


def solve_all(numbers: Sequence[int], folder: Path, workers: int | None = None) -> list[Solved]:
    """The cases of some experiments, in order; finished ones are read from the folder."""
    cases, done = needed(numbers), dict[Key, Solved]()
    with Store(folder, provenance()) as store:
        while waiting := [case for case in cases if case.key not in done]:
            tasks = []
            for case in waiting:
                if case.after is None or case.after.key in done:
                    before = done[case.after.key] if case.after else None
                    tasks.append((case.key, before))
            known = {key: load(store, key, before) for key, before in tasks}
            todo = [(key, before) for key, before in tasks if known[key] is None]
            done |= {key: solution for key, solution in known.items() if solution}
            for _, solution in run(_solved, todo, workers, progress="problems"):
                save(store, solution)
                done[solution.key] = solution
    return [done[case.key] for case in cases if case.experiment in numbers]


def _solved(task: tuple[Key, Solved | None]) -> Solved:
    """Solve a case given by its key, after the one that it continues."""
    key, before = task
    return solved(case_of(key), before)


def save(store: Store, solution: Solved) -> None:
    """Keep a solved case in a store."""
    name = name_of(solution.key)
    solution.extremal.save(store.folder / f"{name}.npz")
    search = {field: getattr(solution, field) for field in SEARCH}
    store.save(f"{name}_search", search, files=[f"{name}.npz"])


def load(store: Store, key: Key, before: Solved | None) -> Solved | None:
    """A solved case from a store; None if it is missing."""
    case, name = case_of(key), name_of(key)
    if f"{name}_search" not in store:
        return None
    problem = case.problem(before.extremal if before else None)
    try:
        extremal = Extremal.load(store.folder / f"{name}.npz", problem)
    except ExtremalFileError:
        return None
    if case.quickest:
        extremal = dataclasses.replace(extremal, problem=of_durations(problem, extremal.phases))
    search = store.load(f"{name}_search")
    search["optima"] = tuple(map(tuple, search["optima"]))
    return Solved(key, extremal, **search, **simulated(case, extremal, before))


def name_of(key: Key) -> str:
    """The name of a case's file."""
    experiment, variant = key
    return f"{experiment}_{re.sub(r'[^0-9A-Za-z.]+', '_', variant)}"


def write(folder: Path, solutions: Sequence[Solved], rows: Sequence[dict[str, Any]]) -> None:
    """Write results.json and the figures into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "results.json", json.dumps(rows, indent=1, allow_nan=False) + "\n")
    for name, key in SHOWN.items():
        for solution in solutions:
            if solution.key == key:
                figure(solution).savefig(folder / f"{name}.png", dpi=90)


def figure(solution: Solved) -> Figure:
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


def _line(solution: Solved) -> str:
    printed = solution.case.printed[0]
    thesis = "-" if printed.cost is None else f"{printed.cost:.6f}"
    outcome = "converged" if solution.converged else "NOT CONVERGED"
    starts = f"{solution.reaching}/{solution.case.effort.starts} starts"
    return (
        f"{solution.key[0]}  {printed.variant:<44} cost {solution.extremal.cost:12.6f} "
        f"(thesis {thesis:>12})  {starts:<12}  {outcome}"
    )
