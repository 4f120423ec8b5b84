"""What a cluster costs: real tasks on 1 and 2 workers, and sleeping ones on hundreds.

Sleeping workers are threads of this process, each a Dask worker of its own, so that what limits a
cluster of any size, the one driver and the one scheduler, is measured without its computers. Here
they also do the workers' part of the communication: what is measured is an upper bound.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from functools import partial
from typing import Any, NamedTuple

import cloudpickle

from agents.cli.options import MaybePath
from rimless_gym.presets import BUILDABLE
from scripts.studies.documents.markdown import marks, percent, refresh, table
from scripts.studies.fronts.solving import Place, RandomStarts, SolveAttempt, attempts
from trajopt import pool
from trajopt.cluster import connected

MARKS = marks("cluster", ("tasks", "model"))

#: Speeds of random starts of the front's search, a task each (m/s).
SPEEDS = tuple(round(0.45 + 0.015 * number, 3) for number in range(12))

#: Sleeping workers, how long a task sleeps (s), how many each of them does, and how many tasks of
#: no length measure what one costs.
WORKERS, SLEEP, EACH, EMPTY = (1, 10, 50, 100, 200, 300), 10.0, 2, 600

#: Sizes of clusters, and lengths of tasks (s), for which the model predicts.
PREDICTED, LENGTHS = (100, 1000, 10_000), (1.0, 10.0, 60.0, 600.0)


def cluster(*, docs: MaybePath = None) -> int:
    """Measure what a cluster costs, and what limits it.

    Args:
        docs: a page, docs/cluster.md, to put the tables into.
    """
    sections = {"tasks": real_tasks(), "model": model()}
    print("\n\n".join(sections.values()))
    if docs:
        refresh(docs, MARKS, {name: text + "\n" for name, text in sections.items()})
    return 0


def real_tasks() -> str:
    """Tasks of a front's search in local processes and on Dask's workers.

    Efficiency is the share of the workers' time that is spent in tasks. So other work on the
    computer, which makes tasks take longer, does not count.
    """
    tasks = [RandomStarts(Place(0, speed, 1), ((-1, 0, 1),)) for speed in SPEEDS]
    rows = []
    for name, workers in (("local processes", 2), ("Dask", 1), ("Dask", 2)):
        with connected("auto", workers) if name == "Dask" else nullcontext():
            list(pool.run(_timed_attempts, tasks[:workers], workers))  # imports
            seconds, results = _timed(partial(pool.run, _timed_attempts, tasks, workers))
        inside = sum(duration for _, (duration, _, _) in results)
        cpu = sum(each for _, (_, each, _) in results) / len(tasks)
        rows.append((name, workers, f"{cpu:.2f}", percent(inside / (workers * seconds))))
    sent = sum(len(cloudpickle.dumps((_timed_attempts, task))) for task in tasks) / len(tasks)
    back = sum(len(cloudpickle.dumps(result)) for _, result in results) / len(tasks)
    head = ["workers", "number", "CPU seconds per task", "efficiency"]
    return f"{table(head, rows)}\n\nA task is {sent:,.0f} bytes, its result {back:,.0f}."


def _timed_attempts(task: RandomStarts) -> tuple[float, float, list[SolveAttempt]]:
    """How long a task takes (s), that of the processor, and its result."""
    begun, cpu = time.perf_counter(), time.thread_time()
    made = attempts(BUILDABLE, task)
    return time.perf_counter() - begun, time.thread_time() - cpu, made


def _timed(run: Callable[[], Iterable[Any]]) -> tuple[float, list[Any]]:
    begun = time.perf_counter()
    results = list(run())
    return time.perf_counter() - begun, results


def model() -> str:
    """Sleeping tasks: measured efficiency beside that of the model, and what the model predicts.

    A worker waits `latency` for its next task, and driver and scheduler together need `cost` of
    each task, one after the other: tasks per second = min(workers / (length + latency), 1 / cost).
    """
    measured = {workers: _sleeping(workers) for workers in WORKERS}
    latency, cost = measured[1].latency, max(each.cost for each in measured.values())

    def efficiency(workers: int, length: float) -> str:
        return percent(length / workers * min(workers / (length + latency), 1 / cost))

    head = ["sleeping workers", "CPU per task", f"efficiency, tasks of {SLEEP:g} s", "model"]
    rows = [
        (f"{n}", f"{1e3 * each.cost:.1f} ms", percent(each.efficiency), efficiency(n, SLEEP))
        for n, each in measured.items()
    ]
    predicted = [
        (f"{workers:,}", *(efficiency(workers, length) for length in LENGTHS))
        for workers in PREDICTED
    ]
    return "\n\n".join(
        [
            table(head, rows),
            f"With a latency of {1e3 * latency:.0f} ms and a cost of {1e3 * cost:.1f} ms, at most "
            f"{1 / cost:.0f} tasks/s, the model predicts these efficiencies:",
            table(["workers", *(f"tasks of {each:g} s" for each in LENGTHS)], predicted),
        ]
    )


class Overhead(NamedTuple):
    """What sleeping workers measured."""

    latency: float  # least time in which a task of no length comes back (s)
    cost: float  # CPU time of this process for each of many such tasks (s)
    efficiency: float  # of tasks that sleep


def _sleeping(workers: int) -> Overhead:
    """Measure with so many sleeping workers."""
    import dask
    from distributed import LocalCluster

    # hundreds of profilers in one process would be all that it does
    dask.config.set({"distributed.worker.profile.enabled": False})
    dask.config.set({"distributed.admin.system-monitor.interval": "60s"})
    threads: dict[str, Any] = {"processes": False, "threads_per_worker": 1, "memory_limit": 0}
    silent: dict[str, Any] = {"dashboard_address": None, "silence_logs": logging.CRITICAL}
    with LocalCluster(n_workers=workers, protocol="tcp", **threads, **silent) as local:
        address = local.scheduler_address.replace("tcp", "dask")
        with connected(address):
            alone = [_timed(lambda: pool.run(time.sleep, [0.0]))[0] for _ in range(20)]
            begun = time.process_time()
            list(pool.run(time.sleep, [0.0] * EMPTY))
            cost = (time.process_time() - begun) / EMPTY
            seconds, _ = _timed(lambda: pool.run(time.sleep, [SLEEP] * (EACH * workers)))
    return Overhead(min(alone), cost, EACH * SLEEP / seconds)
