"""Ctrl-C that loses nothing: neither the signal itself nor what was finished before it."""

from __future__ import annotations

import io
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Generic, TypeVar

T = TypeVar("T")


class Interrupted(KeyboardInterrupt, Generic[T]):
    """Ctrl-C was pressed, and part of the work was finished.

    Attributes:
        partial: the finished part, of the type that would have been returned.
    """

    def __init__(self, partial: T) -> None:
        super().__init__("interrupted: what was finished is in `partial`")
        self.partial = partial


@contextmanager
def heeded() -> Iterator[None]:
    """Make Ctrl-C in this context raise KeyboardInterrupt, at the latest at the context's end.

    Without it, CasADi's wrappers lose about one Ctrl-C in ten, or turn it into a SystemError. What
    CasADi itself says of it on stderr is not shown.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pressed = threading.Event()
    former, stderr = signal.getsignal(signal.SIGINT), sys.stderr

    def press(number: int, frame: FrameType | None) -> None:
        pressed.set()
        sys.stderr = io.StringIO()
        if callable(former):
            former(number, frame)

    signal.signal(signal.SIGINT, press)
    try:
        yield
    except Exception as error:
        if pressed.is_set():
            raise KeyboardInterrupt from error
        raise
    finally:
        signal.signal(signal.SIGINT, former)
        sys.stderr = stderr
    if pressed.is_set() and former is signal.default_int_handler:
        raise KeyboardInterrupt
