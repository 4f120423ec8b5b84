"""Worker processes that end with whoever began them, however that one ends.

Every worker watches a pipe of which its parent alone has the other end. That one is closed when
the parent gives its workers up, and by the operating system when the parent is no more, killed or
not. (CasADi lets other threads run while it solves, so that the watch is never late.)
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
    """Processes for as long as the context lasts; at an exception their work is given up.

    They never see Ctrl-C, which is for their parent.

    Args:
        workers: how many, at least 1; they begin when there is something to do.
        begin: called with `arguments` in each of them, before anything else.
        arguments: of `begin`; to be pickled.

    Raises:
        RuntimeError: a worker ended by itself.
    """
    context = get_context("spawn")
    watched, alive = context.Pipe(duplex=False)
    executor = ProcessPoolExecutor(workers, context, _begin, (watched, begin, arguments))

    def submit(function: Callable[..., Any], *inputs: Any) -> Future[Any]:
        with _ctrl_c_blocked():  # which a process that begins in here inherits
            return executor.submit(function, *inputs)

    try:
        yield submit
        executor.shutdown()
    except BrokenProcessPool as error:
        raise RuntimeError(
            "a worker process ended before its work did: in a script, what uses workers must stand "
            'below `if __name__ == "__main__":`; otherwise it was killed or ran out of memory, and '
            "fewer workers help"
        ) from error
    finally:
        alive.close()  # at an exception the workers end at once
        executor.shutdown(cancel_futures=True)
        watched.close()


def require_picklable(name: str, value: Any) -> None:
    """Refuse what cannot be sent to other processes.

    Raises:
        TypeError: `value` cannot.
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
    """Ctrl-C waits."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(watched: Connection, begin: Callable[..., object] | None, inputs: tuple[Any]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where it cannot be blocked
    threading.Thread(target=_end_with, args=(watched,), daemon=True).start()
    if begin is not None:
        begin(*inputs)


def _end_with(watched: Connection) -> None:
    """End this process, whatever it is doing, when the other end of a pipe is closed."""
    with suppress(OSError):
        watched.poll(None)
    os._exit(1)
