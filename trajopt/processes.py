"""Worker processes that end when their parent does, even if it is killed.

Every worker watches a pipe whose other end only its parent holds. The parent closes that end when
it gives up its workers, and the operating system closes it when the parent dies. (CasADi releases
the interpreter lock while it solves, so that the watching thread always gets to run.)
"""

from __future__ import annotations

import os
import pickle
import signal
import threading
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeAlias

#: (function, *arguments) -> the future of its result in another process.
Submit: TypeAlias = Callable[..., Future[Any]]


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
        RuntimeError: a worker ended before its work was done.
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
        raise RuntimeError(
            "a worker process ended before its work was done: in a script, code that uses workers "
            'must stand below `if __name__ == "__main__":`; if it does, the worker was killed or '
            "ran out of memory: use fewer workers"
        ) from error
    finally:
        alive.close()  # at an exception the workers end at once
        executor.shutdown(cancel_futures=True)
        watched.close()


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
