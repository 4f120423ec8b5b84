"""The stages of a comparison, one after the other or side by side in processes.

A stage leaves its result in the study's folder and takes those of others from there, so that it
does not matter which process runs it, or when.
"""

from __future__ import annotations

import re
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr, suppress
from pathlib import Path

from tqdm import tqdm

from agents.comparison.arena import Arena, Result
from agents.comparison.entrants import Entrant
from agents.comparison.stages import read_stage, write_stage
from agents.comparison.study import Study
from trajopt.processes import crew
from trajopt.provenance import provenance

#: How often the line that shows what is running is written anew (s).
TICK = 1.0

BAR = "{desc}: {n_fmt}/{total_fmt} |{bar:12}| {elapsed}{postfix}"

#: A progress bar of tqdm, and how far it has come.
_SHARE = re.compile(r"(\d+)%\|")


def completed(arena: Arena, entrants: Sequence[Entrant], workers: int) -> dict[str, Result]:
    """The results of all entrants by name, in their order; those that are kept are not run again.

    Args:
        arena: where they compete.
        entrants: who competes.
        workers: processes; one works in this process.

    Raises:
        ValueError: a kept result is damaged, or of another study.
        KilledError: the process of an entrant was killed; the same call goes on.
        KeyboardInterrupt: somebody asked to stop; the same call goes on.
    """
    before = {each.name: _kept(arena, each) for each in entrants}
    todo = most_urgent_first([each for each in entrants if before[each.name] is None])
    run = _one_by_one if workers == 1 or len(todo) <= 1 else _side_by_side
    done = len(entrants) - len(todo)
    for name in run(arena, todo, workers):
        done += 1
        seconds = _result(arena, name)["wall_time_s"]
        _tell(arena, f"[{done}/{len(entrants)}] {name}: done in {seconds} s")
    return {each.name: before[each.name] or _result(arena, each.name) for each in entrants}


def most_urgent_first(entrants: Sequence[Entrant]) -> list[Entrant]:
    """In order of the time from an entrant's start to the end of the last that waits for it.

    Whoever is waited for comes before whoever waits.
    """

    def urgency(entrant: Entrant) -> float:
        waiting = [each for each in entrants if entrant.name in each.after]
        return entrant.effort + max(map(urgency, waiting), default=0.0)

    return sorted(entrants, key=urgency, reverse=True)


def _kept(arena: Arena, entrant: Entrant) -> Result | None:
    """The result of an entrant that competed before, if its files have not changed since."""
    name, revision = entrant.name, provenance()["git_revision"]
    result, changed = read_stage(arena.out, name, arena.identity)
    if changed:
        _tell(arena, f"{name}: {', '.join(changed)} is missing or changed: run again")
        shutil.rmtree(arena.out / name, ignore_errors=True)  # of a training
        (arena.out / f"{name}.json").unlink()
        return None
    if result is None:
        return None
    _log(arena.out, name).unlink(missing_ok=True)  # of a run stopped after its last line
    _tell(arena, f"{name}: kept")
    if result["git_revision"] != revision:
        _tell(
            arena,
            f"warning: {name} was made by revision {result['git_revision']}, this is {revision}; "
            f"remove {arena.out} to make it anew",
        )
    return result


def _result(arena: Arena, name: str) -> Result:
    """What a stage that has run has left."""
    return read_stage(arena.out, name, arena.identity)[0] or {}


def _tell(arena: Arena, text: str) -> None:
    if arena.progress:
        tqdm.write(text, sys.stderr)


def _compete(arena: Arena, entrant: Entrant) -> None:
    """Let an entrant compete, and leave its result in the folder."""
    began, busy = time.perf_counter(), time.process_time()
    result = entrant.compete(arena)
    times = {
        "wall_time_s": round(time.perf_counter() - began, 1),
        "processor_time_s": round(time.process_time() - busy, 1),
    }
    write_stage(arena.out, entrant.name, arena.identity, result | times | provenance())


def _one_by_one(arena: Arena, todo: Sequence[Entrant], workers: int) -> Iterator[str]:
    for entrant in todo:
        _tell(arena, f"{entrant.name} ...")
        _compete(arena, entrant)
        yield entrant.name


def _side_by_side(arena: Arena, todo: Sequence[Entrant], workers: int) -> Iterator[str]:
    """Run entrants as soon as nobody they wait for is left, the most urgent first."""
    left = list(todo)
    with (
        crew(workers) as at_work,
        tqdm(
            total=len(todo), desc="compare", bar_format=BAR, disable=not arena.progress, leave=False
        ) as bar,
    ):
        while left or at_work.busy:
            unfinished = {each.name for each in left} | set(at_work.busy)
            ready = [each for each in left if not unfinished & set(each.after)]
            for entrant in ready[: at_work.free]:
                left.remove(entrant)
                inputs = arena.study, arena.out, arena.progress, entrant
                at_work.begin(entrant.name, _apart, *inputs)
            bar.set_postfix_str("; ".join(_state(arena.out, name) for name in at_work.busy))
            for name, _ in at_work.done(TICK):
                bar.update()
                yield _read_log(arena, name)


def _apart(study: Study, out: Path, progress: bool, entrant: Entrant) -> None:
    """Let an entrant compete in another process, which writes to a log what it would show."""
    log = _log(out, entrant.name)
    with log.open("w", buffering=1, errors="replace") as file, redirect_stderr(file):
        _compete(Arena(study, out, progress), entrant)


def _log(out: Path, name: str) -> Path:
    return out / f"{name}.log"


def _state(out: Path, name: str) -> str:
    """An entrant that is competing, and how far its last progress bar has come."""
    shares: list[str] = []
    with suppress(OSError):
        shares = _SHARE.findall(_log(out, name).read_text(errors="replace")[-500:])
    return f"{name} {shares[-1]} %" if shares else name


def _read_log(arena: Arena, name: str) -> str:
    """Show what an entrant that is done wrote, other than progress bars, and remove its log."""
    log = _log(arena.out, name)
    for line in log.read_text(errors="replace").splitlines():
        said = line.strip()
        if said and not _SHARE.search(said):
            _tell(arena, f"{name}: {said}")
    log.unlink()
    return name
