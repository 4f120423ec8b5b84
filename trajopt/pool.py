"""Independent tasks side by side: in local processes by joblib, or on a cluster (`cluster.py`).

How far long work is appears on a terminal, unless it is a task of several.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sized
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

from tqdm import tqdm

Task = TypeVar("Task")
Result = TypeVar("Result")

#: How often a progress bar shows the time (s).
TICK = 1.0

#: How often a worker checks that its parent is alive (s).
WATCH = 0.5

#: How many cores the task that this worker does may use; None in other processes.
_share: ContextVar[int | None] = ContextVar("_share", default=None)

#: What does the tasks in place of local processes; see `elsewhere`.
_engine: ContextVar[Callable[..., Generator[Any, None, None]] | None] = ContextVar(
    "_engine", default=None
)


class KilledError(RuntimeError):
    """A worker process ended before its work was done."""


def run(
    function: Callable[[Task], Result],
    tasks: Iterable[Task],
    workers: int | None = None,
    *,
    progress: str = "",
) -> Generator[tuple[Task, Result], None, None]:
    """Call a function for every task; each task with its result, as they are finished.

    With one local worker, or one task, this process does the work, in the order of the tasks. An
    exception, of a task or where the results are used, ends the others. They end with this process,
    too, however it ends. (Use `contextlib.closing` where the end of the loop must not wait for the
    interpreter to collect the iterator.)

    Args:
        function: of one task. In other processes it and its results must be picklable; functions
            that are defined in a script or in other functions are, by cloudpickle.
        tasks: are drawn one by one, when a worker is about to be free.
        workers: how many local processes; by default as many as `cores`. A cluster
            (`trajopt.cluster.connected`) is used as a whole.
        progress: title of a progress bar, shown on a terminal; none by default.

    Raises:
        ConnectionError: the cluster has ended, or has other versions.
        KilledError: a worker was killed.
    """
    total = len(tasks) if isinstance(tasks, Sized) else None
    workers = workers or cores()
    workers = workers if total is None else max(1, min(workers, total))
    if engine := _engine.get():
        results = engine(function, tasks)
    elif workers == 1:
        results = ((task, function(task)) for task in tasks)
    else:
        results = _shared(function, tasks, workers)
    bar = progress_bar(progress, bool(progress), total=total, smoothing=0.1)
    with closing(results), bar:
        for each in results:
            bar.update()
            yield each


def progress_bar(title: str, progress: bool = True, **settings: Any) -> tqdm[Any]:
    """A progress bar with further settings of tqdm; only on a terminal, and not in workers."""
    hidden = not progress or _share.get() is not None
    bar = tqdm(desc=title, disable=True if hidden else None, **settings)
    if not bar.disable:
        threading.Thread(target=_keep_time, args=(bar,), daemon=True).start()
    return bar


def _keep_time(bar: tqdm[Any]) -> None:
    """Show the time of a bar as it passes, also while one of its tasks takes long."""
    while True:
        time.sleep(TICK)
        with bar.get_lock():
            if bar.disable:  # it is closed
                return
            bar.refresh(nolock=True)


def announce(text: str) -> None:
    """Print a line to stderr before something that takes long; not in workers."""
    if _share.get() is None:
        tqdm.write(f"rimless_gym: {text}", sys.stderr)


def cores() -> int:
    """How many cores to use: those of the computer, or in a worker its share of them."""
    if hasattr(os, "sched_getaffinity"):
        return _share.get() or len(os.sched_getaffinity(0))
    return _share.get() or os.cpu_count() or 1


@contextmanager
def elsewhere(engine: Callable[..., Generator[Any, None, None]]) -> Iterator[None]:
    """Within this block, `run` returns what `engine` does, which takes a function and tasks."""
    token = _engine.set(engine)
    try:
        yield
    finally:
        _engine.reset(token)


def _shared(
    function: Callable[[Task], Result], tasks: Iterable[Task], workers: int
) -> Generator[tuple[Task, Result], None, None]:
    import joblib  # a quarter of a second

    # Loky replaces a worker that has grown by 300 MB, which CasADi's do in time, and loses nothing.
    warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
    share = max(1, cores() // workers)
    drawn: dict[int, Task] = {}

    def calls() -> Iterator[Any]:
        for number, task in enumerate(tasks):
            drawn[number] = task
            yield joblib.delayed(call)(function, task, number, share)

    config: dict[str, Any] = {"backend": "loky", "n_jobs": workers}
    config |= {"initializer": _begin, "initargs": (os.getpid(),)}
    with joblib.parallel_config(**config):
        parallel = joblib.Parallel(
            batch_size=1,
            pre_dispatch="n_jobs",
            max_nbytes=None,  # or large arrays would reach tasks as read-only files
            return_as="generator_unordered",
        )
    results: Generator[tuple[int, Result], None, None] | None = None
    try:
        with ctrl_c_blocked():  # workers and threads that start in here inherit this
            results = parallel(calls())
        for number, result in results:
            yield drawn.pop(number), result
    except BrokenProcessPool as error:  # perhaps before the last task was given out
        raise KilledError(
            "a worker process ended before its work was done: it was killed, most likely "
            "because memory ran out; make room, or use fewer workers"
        ) from error
    finally:
        if results is not None:
            with warnings.catch_warnings(action="ignore"):  # of results that nobody will use
                results.close()


def call(
    function: Callable[[Task], Result], task: Task, number: int, share: int
) -> tuple[int, Result]:
    """Call a function in a worker."""
    token = _share.set(share)
    try:
        return number, function(task)
    finally:
        _share.reset(token)


def _begin(parent: int) -> None:
    """Begin a local worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # only the parent handles Ctrl-C
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process soon after its parent, which may be killed and unable to do so.

    (CasADi and numba's loops release the interpreter's lock, so that this thread can run.)
    """
    while os.getppid() == parent:
        time.sleep(WATCH)
    os._exit(1)


@contextmanager
def ctrl_c_blocked() -> Iterator[None]:
    """Hold back Ctrl-C until the end of the block."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
