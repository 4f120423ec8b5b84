"""Tasks on a Dask or Ray cluster: the same functions, files and results as with local processes.

Within `connected`, `trajopt.pool.run` gives its tasks to the cluster. One task at a time goes to
each worker, so that what is left of them is always known here. If a worker is killed, its task
begins again on another. If this process ends, so do its tasks.
"""

from __future__ import annotations

import functools
import importlib
import logging
import math
import os
import platform
import queue
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from itertools import islice
from typing import Any, NamedTuple, Protocol, TypeVar

import cloudpickle

from rimless_gym.checks import extra
from trajopt import pool

Task = TypeVar("Task")
Result = TypeVar("Result")

#: An address that stands for a Dask cluster of processes on this computer.
AUTO = "auto"

#: How long to wait for an answer, and for a worker where there is none (s).
ANSWER, PATIENCE = 10.0, 300.0

#: How often workers are counted (s).
COUNTED = 2.0

#: How often a Dask worker checks whether its task is still wanted (s).
WATCH = 0.5

#: How often a task begins again because its worker was killed.
RETRIES = 3

#: What must be the same everywhere: whose sources, and whose versions.
SOURCES = ("rimless_gym", "trajopt", "agents")
VERSIONS = ("casadi", "llvmlite", "numba", "numpy", "scipy", "stable-baselines3", "torch")

#: The entry of versions that may differ.
PROCESSOR = "processor"


class Origin(NamedTuple):
    """Where tasks come from."""

    folder: str  # in which the command runs
    versions: dict[str, str]  # see `_versions`


class _Engine(Protocol):
    """A connection to a cluster."""

    killed: tuple[type[Exception], ...]  # a worker, more than `RETRIES` times during a task

    def workers(self) -> int:
        """How many tasks can run at a time."""

    def everywhere(self, function: Callable[[str], Any], argument: str) -> Mapping[str, Any]:
        """What a function returns on every worker, or the exception that it raises."""

    def submit(self, origin: Origin, content: bytes) -> Any:
        """A future, as those of `concurrent.futures`, of `_work` on a free worker."""

    def cancel(self, futures: Sequence[Any]) -> None:
        """Kill tasks."""

    def close(self) -> None:
        """Disconnect."""


@contextmanager
def connected(address: str, workers: int | None = None) -> Iterator[None]:
    """Let `trajopt.pool.run` use a cluster within this block, and all of its workers.

        with connected("dask://scheduler:8786"):
            search = multi_start(problem, family, starts=1000)

    Workers need the same versions of rimless-gym, Python and what computes. The folder of results
    that tasks write themselves (of trainings, say) must be on a file system that they share.

    Args:
        address: "dask://HOST:PORT" of a scheduler, "ray://HOST:PORT" of a Ray client server, or
            "auto": a Dask cluster on this computer, for the time of the block. A script that uses
            it needs `if __name__ == "__main__":`, as Python's own processes do.
        workers: of "auto"; by default one for every core.

    Raises:
        ConnectionError: the cluster does not answer, has no workers, or other versions; or it ends
            before its work is done.
        KilledError: the worker of a task was killed several times.
        MissingExtraError: Dask or Ray is not installed.
        ValueError: this is no address of a cluster.
    """
    scheme, _, place = address.partition("://")
    if not (address == AUTO or (scheme in ("dask", "ray") and place)):
        raise ValueError(
            f"cluster = {address!r}: must be dask://HOST:PORT, ray://HOST:PORT or {AUTO}"
        )
    with extra("cluster"):
        engine: _Engine = _Ray(address) if scheme == "ray" else _Dask(address, workers)
    try:
        origin = Origin(os.getcwd(), _versions(os.getcwd()))
        _require_equal(engine, address, origin)
        with pool.elsewhere(functools.partial(_run, engine, address, origin)):
            yield
    finally:
        engine.close()


def _run(
    engine: _Engine,
    address: str,
    origin: Origin,
    function: Callable[[Task], Result],
    tasks: Iterable[Task],
) -> Generator[tuple[Task, Result], None, None]:
    """See `trajopt.pool.run`."""
    left, pending, finished = iter(tasks), dict[Any, Task](), queue.SimpleQueue[Any]()
    workers, counted, occupied, more = 0, -math.inf, time.monotonic(), True
    try:
        while True:
            now = time.monotonic()
            if now - counted > COUNTED:
                workers, counted = _count(engine, address), now
                occupied = now if workers else occupied
            if now - occupied > PATIENCE:
                raise _no_workers(address)
            free = max(0, workers - len(pending))
            for task in (taken := list(islice(left, free))):
                future = engine.submit(origin, cloudpickle.dumps((function, task)))
                pending[future] = task
                future.add_done_callback(finished.put)
            more = more and len(taken) == free
            if not (more or pending):
                return
            try:
                future = finished.get(timeout=COUNTED)
            except queue.Empty:
                continue
            yield pending.pop(future), _result(engine, address, future)
    finally:
        with suppress(Exception):  # a cluster that is gone has lost them anyway
            engine.cancel(list(pending))


def _result(engine: _Engine, address: str, future: Any) -> Any:
    """What a task returned; raises what it raised."""
    try:
        result, error = cloudpickle.loads(future.result())
    except engine.killed as killed:
        raise pool.KilledError(
            f"{address}: the worker of a task was killed {RETRIES + 1} times, most likely because "
            "memory ran out: give workers more memory, or start fewer on a computer"
        ) from killed
    except Exception as gone:
        raise _ended(address, gone) from gone
    if error is not None:
        raise error
    return result


def _count(engine: _Engine, address: str) -> int:
    """The workers of a cluster."""
    try:
        return engine.workers()
    except ConnectionRefusedError:
        raise
    except Exception as gone:
        raise _ended(address, gone) from gone


def _no_workers(address: str) -> ConnectionError:
    return ConnectionError(
        f"{address} has had no worker for {PATIENCE:g} s: start some; the same command continues"
    )


def _ended(address: str, error: Exception) -> ConnectionError:
    return ConnectionError(
        f"{address} has ended, or cannot be reached any more ({type(error).__name__}: {error}): "
        "start it again; finished work is kept where the command keeps it, and the same command "
        "continues"
    )


# -- versions --------------------------------------------------------------------------------------


def _require_equal(engine: _Engine, address: str, origin: Origin) -> None:
    """Wait for workers; refuse those that would compute something else, before any has a task."""
    begun = time.monotonic()
    if not _count(engine, address):
        pool.announce(f"waiting for workers of {address}")
    while not _count(engine, address):
        if time.monotonic() - begun > PATIENCE:
            raise _no_workers(address)
        time.sleep(WATCH)
    others = set()
    for worker, found in engine.everywhere(_versions, origin.folder).items():
        if isinstance(found, BaseException):
            raise ConnectionRefusedError(
                f"{address}: worker {worker} cannot import rimless-gym ({found}): install the same "
                "versions there as here"
            ) from found
        _compare(origin, found, f"{address}: worker {worker}")
        others |= {found[PROCESSOR]} - {origin.versions[PROCESSOR]}
    if others:
        pool.announce(
            f"workers have other processors ({', '.join(sorted(others))}): results are those of "
            "this computer to rounding, not to the last digit"
        )


def _compare(origin: Origin, found: Mapping[str, str], worker: str) -> None:
    """Refuse a worker that has other versions than the process from which tasks come."""
    for name, wanted in origin.versions.items():
        if name != PROCESSOR and found.get(name) != wanted:
            raise ConnectionRefusedError(
                f"{worker} has {name} {found.get(name)}, not {wanted}: install the same versions "
                "there as here, and start the workers again"
            )


@functools.cache
def _versions(folder: str) -> dict[str, str]:
    """Versions, digests of the sources, and the processor for which numba compiles.

    A worker works in the folder in which the command runs, if it has it, and imports from there
    what is not installed.
    """
    with suppress(OSError):
        os.chdir(folder)
    if folder not in sys.path:
        sys.path.append(folder)
    from llvmlite.binding import get_host_cpu_name

    from rimless_gym.jit import fingerprint

    found = {
        PROCESSOR: get_host_cpu_name(),
        "Python": f"{sys.version_info[0]}.{sys.version_info[1]}",
    }
    for name in SOURCES:
        importlib.import_module(name)
        found[f"sources of {name}"] = fingerprint(name)
    for name in VERSIONS:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


# -- on workers ------------------------------------------------------------------------------------


def _work(origin: Origin, content: bytes) -> bytes:
    """Call a pickled function with its task; pickled: the result and None, or None and an error."""
    try:
        _compare(origin, _versions(origin.folder), f"a new worker on {platform.node()}")
        function, task = cloudpickle.loads(content)
        return cloudpickle.dumps((pool.call(function, task, 0, 1)[1], None))
    except Exception as error:
        error.add_note("on a worker:\n" + "".join(traceback.format_tb(error.__traceback__)))
        return cloudpickle.dumps((None, error))


def _work_while_wanted(origin: Origin, content: bytes) -> bytes:
    """As `_work`, in a Dask worker: it ends when nobody wants the task any more, and begins anew.

    Dask itself lets tasks run to their end that are cancelled, or whose client is gone.
    """
    from distributed import get_worker

    worker, done = get_worker(), threading.Event()
    key = worker.get_current_task()

    def watch() -> None:
        while not done.wait(WATCH):
            task = worker.state.tasks.get(key)
            if task is None or task.state == "cancelled":
                os._exit(1)

    if worker.nanny:  # starts it again
        threading.Thread(target=watch, daemon=True).start()
    try:
        return _work(origin, content)
    finally:
        done.set()


# -- engines ---------------------------------------------------------------------------------------


class _Dask:
    """A connection to a Dask cluster, or to one of its own; see `_Engine`."""

    def __init__(self, address: str, workers: int | None) -> None:
        import dask
        from distributed import Client, KilledWorker, LocalCluster

        self.killed: tuple[type[Exception], ...] = (KilledWorker,)
        self._local = None
        place = address.replace("dask", "tcp", 1)
        if address == AUTO:
            with (
                pool.ctrl_c_blocked(),  # workers inherit this
                dask.config.set({"distributed.scheduler.allowed-failures": RETRIES}),
            ):
                self._local = LocalCluster(
                    n_workers=workers or pool.cores(),
                    threads_per_worker=1,
                    dashboard_address=None,
                    silence_logs=logging.CRITICAL,
                )
            place = self._local.scheduler_address
        try:
            self._client = Client(place, timeout=ANSWER, set_as_default=False)
        except OSError as error:
            raise ConnectionError(
                f"{address}: no Dask scheduler answers ({error}): start one with `dask scheduler`"
            ) from error

    def workers(self) -> int:
        threads = self._client.nthreads()
        for worker, number in threads.items():
            if number > 1:  # the linear solver of IPOPT must not run twice in a process
                raise ConnectionRefusedError(
                    f"worker {worker} runs {number} tasks in one process: start "
                    f"`dask worker --nworkers {number} --nthreads 1`"
                )
        return len(threads)

    def everywhere(self, function: Callable[[str], Any], argument: str) -> Mapping[str, Any]:
        found: Mapping[str, Any] = self._client.run(function, argument, on_error="return")
        return found

    def submit(self, origin: Origin, content: bytes) -> Any:
        return self._client.submit(_work_while_wanted, origin, content, pure=False)

    def cancel(self, futures: Sequence[Any]) -> None:
        self._client.cancel(futures)

    def close(self) -> None:
        self._client.close()
        if self._local is not None:
            self._local.close()


class _Ray:
    """A connection to a Ray cluster; see `_Engine`."""

    def __init__(self, address: str) -> None:
        import ray
        from ray import exceptions

        self.killed: tuple[type[Exception], ...] = (
            exceptions.WorkerCrashedError,
            exceptions.OutOfMemoryError,
            exceptions.NodeDiedError,
        )
        self._ray = ray
        try:
            ray.init(address, log_to_driver=False, logging_level=logging.ERROR)
        except Exception as error:  # of many kinds
            raise ConnectionError(
                f"{address}: no Ray client server of the same version answers ({error}): start one "
                "with `ray start --head --ray-client-server-port PORT`"
            ) from error
        self._work = ray.remote(_work).options(num_cpus=1, max_retries=RETRIES)

    def workers(self) -> int:
        return int(self._ray.cluster_resources().get("CPU", 0))

    def everywhere(self, function: Callable[[str], Any], argument: str) -> Mapping[str, Any]:
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

        def call() -> Any:
            return function(argument)

        found: dict[str, Any] = {}
        for node in self._ray.nodes():
            if node["Alive"]:
                here = NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
                task = self._ray.remote(call).options(num_cpus=0, scheduling_strategy=here)
                found[f"{node['NodeManagerAddress']} {node['NodeID'][:6]}"] = task.remote()
        for node, result in found.items():
            try:
                found[node] = self._ray.get(result)
            except Exception as error:  # of many kinds
                found[node] = error
        return found

    def submit(self, origin: Origin, content: bytes) -> Any:
        return self._work.remote(origin, content).future()

    def cancel(self, futures: Sequence[Any]) -> None:
        for future in futures:
            self._ray.cancel(future.object_ref, force=True)

    def close(self) -> None:
        self._ray.shutdown()
