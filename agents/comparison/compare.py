"""The headline: learned against optimal cost of transport, on one model, at equal speed.

Each method leaves its result in the study's folder. However a comparison was stopped, the same call
continues it: finished results are loaded, and so are the gaits and training states of unfinished
ones. The table is the same as without a stop.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

from tqdm import tqdm

from agents.comparison.figures import write_figures
from agents.comparison.methods import LearnedMethod, Method, Result, ShippedMethod, methods
from agents.comparison.study import Setting, Study
from agents.comparison.table import Row, attained_rows, by_speed, format_table
from agents.film import GroupFilm, ghost, record_policy, times
from agents.learner import CLONE, IMITATION
from agents.policy_files import NamedPolicy, load_policy
from rimless_gym.rendering.display import save_gif
from trajopt.pool import run
from trajopt.store import Store, jsonable, provenance, require_shared, write_text

#: Of the results in a study's folder.
FORMAT = 5

#: Seconds of a walk that are animated, and pictures of the animation per second.
ANIMATED, FPS = 10.0, 20

#: How often a task checks whether the results that it needs are there (s).
CHECK = 0.2


def compare(
    study: Study, out: Path, progress: bool = True, workers: int | None = None
) -> list[Row]:
    """Compare all methods of a study; write results.json, table.md, plots and report.html.

    Args:
        study: what to compare.
        out: folder; new, or that of the same study, finished or not.
        progress: whether to show progress.
        workers: processes that the methods share, default: one for each core. The results do not
            depend on their number.

    Returns:
        The rows of the table.

    Raises:
        ValueError: `out` holds another study, or another process is working in it.
        KilledError: the process of a method was killed; the same call continues.
        KeyboardInterrupt: the comparison was stopped; the same call continues.
        OSError: the folder cannot be written.
    """
    setting, compared = Setting(study, out, progress), methods(study)
    inputs = {"study": dataclasses.asdict(study), "format": FORMAT}
    with Store(out, inputs, record="study.json") as store:
        complete(setting, compared, store, workers)
        results = {method.name: store.load(method.name) for method in compared}
        rows = by_speed(r for m in compared for r in m.rows(setting, results[m.name]))
        walks = [each for result in results.values() for each in result.get("evaluations", ())]
        rows += attained_rows(walks, setting.params, setting.best_return)
        report = {**inputs, "table": rows, "results": results, **provenance()}
        write_text(out / "results.json", json.dumps(jsonable(report), indent=1) + "\n")
        write_text(out / "table.md", format_table(rows) + "\n")
        curves = {
            each.title: results[each.name]["curve"]
            for each in compared
            if isinstance(each, LearnedMethod | ShippedMethod) and each.curve
            if results[each.name].get("curve")  # not all policies have kept theirs
        }
        _print(setting, "plots and an animation (some seconds)")
        write_figures(setting, rows, curves)
        _animate(setting)
    return rows


def complete(
    setting: Setting, compared: Sequence[Method], store: Store, workers: int | None
) -> None:
    """Compute the results that the store does not have yet, side by side."""
    todo = [method for method in compared if method.name not in store]
    for method in todo:
        if (setting.out / f"{method.name}.json").exists():
            _print(setting, f"{method.name}: damaged or changed, computed again")
            shutil.rmtree(setting.out / method.name, ignore_errors=True)  # of a training
            (setting.out / f"{method.name}.json").unlink()
    done, work = len(compared) - len(todo), functools.partial(_compute, setting, workers == 1)
    if todo:
        _print(setting, f"{len(todo)} methods to compute, up to some minutes each")
    results = run(work, _ready_first(setting.out, longest_chains_first(todo)), workers)
    with closing(results):
        for method, seconds in results:
            done += 1
            _print(setting, f"[{done}/{len(compared)}] {method.name}: done in {seconds:.0f} s")


def longest_chains_first(todo: Sequence[Method]) -> list[Method]:
    """In order of the number of methods that wait for each other's results, this one's first."""

    def length(method: Method) -> int:
        return 1 + max((length(each) for each in todo if method.name in each.after), default=0)

    return sorted(todo, key=length, reverse=True)


def _ready_first(out: Path, todo: list[Method]) -> Iterator[Method]:
    """Each time the first method whose inputs are there; where there is none, the first one."""
    while todo:
        ready = (method for method in todo if not _missing(out, method))
        method = next(ready, todo[0])
        todo.remove(method)
        yield method


def _missing(out: Path, method: Method) -> bool:
    """Whether a result that a method needs is not there yet."""
    return not all((out / f"{name}.json").exists() for name in method.after)


def _compute(setting: Setting, alone: bool, method: Method) -> float:
    """Compute a result once its inputs are there, and save it; return the seconds that it took."""
    require_shared(setting.out)
    while _missing(setting.out, method):  # another process is computing them
        time.sleep(CHECK)
    began = time.perf_counter()
    setting = Setting(setting.study, setting.out, setting.progress and alone)
    result: Result = method.compute(setting)
    Store(setting.out).save(method.name, result, result.get("files", ()))
    return time.perf_counter() - began


def _animate(setting: Setting) -> None:
    """Animate a walk of the clone beside the optimum."""
    clone = load_policy(setting.out / IMITATION / CLONE)
    policy = NamedPolicy(clone.policy, clone.conditions, IMITATION)
    recording = record_policy(policy, ANIMATED)
    gait = setting.held_gait(setting.study.speed)
    race = GroupFilm([recording, ghost(gait, recording)])
    frames = [race.frame(moment) for moment in times(race.ends, FPS)]
    save_gif(frames, setting.out / f"{IMITATION}.gif", FPS)


def _print(setting: Setting, text: str) -> None:
    if setting.progress:
        tqdm.write(text, sys.stderr)
