"""Ctrl-C, and SIGTERM from batch systems and containers, stop work where nothing is lost."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

#: What Ctrl-C sends, and what batch systems, containers and `kill` send.
SIGNALS = (signal.SIGINT, signal.SIGTERM)

#: How many requests it takes to stop at once.
AT_ONCE = 3


class StopRequest:
    """Whether somebody has asked to stop.

    The first two requests are only noted. The third raises KeyboardInterrupt, except while it is
    held off.

    Args:
        place: where the work will stop, for the message: "at the end of this roll-out".
        loss: what a third request costs, for the message.
    """

    def __init__(self, place: str, loss: str) -> None:
        self._place, self._loss = place, loss
        self._count = 0
        self._held_off = False

    @property
    def made(self) -> bool:
        """Whether the work should stop."""
        return self._count > 0

    def make(self, number: int = signal.SIGINT, frame: FrameType | None = None) -> None:
        """Ask to stop; can be used as a signal handler.

        Raises:
            KeyboardInterrupt: this is the third request or a later one.
        """
        self._count += 1
        if self._count < AT_ONCE:
            again = f"; ask once more to stop at once, which loses {self._loss}"
            _say(f"stopping {self._place}: nothing is lost{again if self._count > 1 else ''}")
        elif not self._held_off:
            raise KeyboardInterrupt

    @contextmanager
    def held_off(self) -> Iterator[None]:
        """Delay interrupts until the block is done, for example while a file is written."""
        self._held_off = True
        try:
            yield
        finally:
            self._held_off = False
        if self._count >= AT_ONCE:
            raise KeyboardInterrupt


@contextmanager
def requests(place: str, loss: str) -> Iterator[StopRequest]:
    """Within the block, Ctrl-C and SIGTERM are requests to stop; see `StopRequest`.

    Outside the main thread signals are left as they are.
    """
    request = StopRequest(place, loss)
    if threading.current_thread() is not threading.main_thread():
        yield request
        return
    former = {number: signal.signal(number, request.make) for number in SIGNALS}
    try:
        yield request
    finally:
        for number, before in former.items():
            signal.signal(number, before)


def _say(text: str) -> None:
    # Not through Python's buffers, which the signal may have interrupted.
    os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, f"\n{text}\n".encode())
