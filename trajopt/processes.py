"""How many cores to use, and worker processes that end when their parent does, even if killed.

Every worker watches a pipe whose other end only its parent holds. The parent closes that end when
it gives up its workers, and the operating system closes it when the parent dies. (CasADi releases
the interpreter lock while it solves, so that the watching thread always gets to run.)
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
from collections.abc import Callable, Collection, Generator, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeAlias

from trajopt.pool import KilledError as KilledError
from trajopt.pool import cores as all_cores

_allowed: ContextVar[int | None] = ContextVar("_allowed", default=None)

#: (function, *arguments) -> the future of its result in another process.
Submit: TypeAlias = Callable[..., Future[Any]]


def cores() -> int:
    """How many cores to use: those of the computer, or fewer within `limited_to`."""
    return _allowed.get() or all_cores()


@contextmanager
def limited_to(number: int) -> Iterator[None]:
    """Within the context, `cores` is this number, at least 1, in this thread."""
    token = _allowed.set(number)
    try:
        yield
    finally:
        _allowed.reset(token)


@contextmanager
def pool(
    workers: int, begin: Callable[..., object] | None = None, *arguments: Any
) -> Iterator[Submit]:
    """Processes for as long as the context lasts; an exception abandons their work.

    They ignore Ctrl-C, which only their parent handles.

    Args:
        workers: how many, at least 1; they start when there is work.
        begin: called with `arguments` in each of them, before anything else.
        arguments: of `begin`; they are pickled.

    Raises:
        KilledError: a worker ended before its work was done.
    """
    context = get_context("spawn")
    watched, alive = context.Pipe(duplex=False)
    executor = ProcessPoolExecutor(workers, context, _begin, (watched, begin, arguments))

    def submit(function: Callable[..., Any], *inputs: Any) -> Future[Any]:
        with _ctrl_c_blocked():  # a process that starts in here inherits this
            return executor.submit(function, *inputs)

    try:
        yield submit
        executor.shutdown()
    except BrokenProcessPool as error:
        raise KilledError(
            "a worker process ended before its work was done: in a script, code that uses workers "
            'must stand below `if __name__ == "__main__":`; if it does, the worker was killed or '
            "ran out of memory: use fewer workers"
        ) from error
    finally:
        alive.close()  # at an exception the workers end at once
        executor.shutdown(cancel_futures=True)
        watched.close()


class Crew:
    """Processes that do one piece of work each, so that it is known whose was killed.

    Args:
        free: how to give work to each of them.
    """

    def __init__(self, free: Collection[Submit]) -> None:
        self._free = list(free)
        self._busy: dict[Future[Any], tuple[str, Submit]] = {}

    @property
    def free(self) -> int:
        """How many have nothing to do."""
        return len(self._free)

    @property
    def busy(self) -> list[str]:
        """The names of the work that is being done, in the order in which it was begun."""
        return [name for name, _ in self._busy.values()]

    def begin(self, name: str, function: Callable[..., Any], *inputs: Any) -> None:
        """Give work to one that is free."""
        submit = self._free.pop()
        self._busy[submit(function, *inputs)] = name, submit

    def done(self, timeout: float | None = None) -> Iterator[tuple[str, Any]]:
        """Wait until some work is done, or for so long (s); its names and results.

        Raises:
            KilledError: its process ended before; or whatever the work raises.
        """
        done, _ = wait(self._busy, timeout, FIRST_COMPLETED)
        for future in sorted(done, key=lambda each: each.exception() is not None):
            name, submit = self._busy.pop(future)
            try:
                result = future.result()
            except (BrokenProcessPool, KilledError) as error:
                raise KilledError(
                    f"{name}: its process was killed, most likely because memory ran out: make "
                    "room, or use fewer workers"
                ) from error
            self._free.append(submit)
            yield name, result


@contextmanager
def crew(workers: int) -> Iterator[Crew]:
    """So many processes (at least 1) for as long as the context lasts; see `pool`."""
    with ExitStack() as stack:
        yield Crew([stack.enter_context(pool(1)) for _ in range(workers)])


def require_picklable(name: str, value: Any) -> None:
    """Refuse a value that cannot be sent to other processes.

    Raises:
        TypeError: `value` cannot be pickled.
    """
    try:
        pickle.dumps(value)
    except Exception as error:  # pickle raises almost anything
        raise TypeError(
            f"{name} = {value!r}: cannot be sent to other processes ({error}); define it at the "
            "top of a module, or use one worker"
        ) from None


@contextmanager
def _ctrl_c_blocked() -> Generator[None, None, None]:
    """Hold back Ctrl-C until the end of the block."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(watched: Connection, begin: Callable[..., object] | None, inputs: tuple[Any]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # for systems on which it cannot be blocked
    threading.Thread(target=_end_with, args=(watched,), daemon=True).start()
    if begin is not None:
        begin(*inputs)


def _end_with(watched: Connection) -> None:
    """End this process at once when the other end of a pipe is closed."""
    with suppress(OSError):
        watched.poll(None)
    os._exit(1)
