"""Several cases solved in several processes, each after the one that it continues."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from types import MappingProxyType

from scripts.studies.thesis.experiments.case import Key
from scripts.studies.thesis.experiments.cases import case_of, needed
from scripts.studies.thesis.experiments.solve import solved
from scripts.studies.thesis.experiments.solved import Solved
from trajopt.processes import pool


def run(
    numbers: Sequence[int], workers: int = 1, known: Mapping[Key, Solved] = MappingProxyType({})
) -> Generator[Solved, None, None]:
    """Solve the cases of some experiments and those that they continue; yield each when finished.

    Args:
        numbers: of the experiments.
        workers: processes.
        known: cases that are solved already, by key; they are not yielded.
    """
    done = dict(known)
    missing = [case for case in needed(numbers) if case.key not in done]
    if workers == 1:
        for case in missing:
            done[case.key] = solved(case, done[case.after.key] if case.after else None)
            yield done[case.key]
        return
    running: set[Future[Solved]] = set()
    with pool(workers) as submit:
        while missing or running:
            for case in [c for c in missing if c.after is None or c.after.key in done]:
                missing.remove(case)
                before = done[case.after.key] if case.after else None
                running.add(submit(_solved, case.key, before))
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                found = future.result()
                done[found.key] = found
                yield found


def _solved(key: Key, before: Solved | None) -> Solved:
    """Solve a case given by its key: cases themselves cannot be pickled."""
    return solved(case_of(key), before)
