"""Ctrl-C, and the SIGTERM of batch systems and containers: work stops where nothing is lost."""

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

#: The request that is no longer waited with.
AT_ONCE = 3


class StopRequest:
    """Whether somebody has asked to stop.

    The first two requests are only noted. The third raises KeyboardInterrupt, except while it is
    held off.

    Args:
        place: where the work will stop, to tell whoever asks: "at the end of this roll-out".
        loss: what the third request costs, to tell as well.
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
        """Ask; may serve as a signal's handler.

        Raises:
            KeyboardInterrupt: for the third time.
        """
        self._count += 1
        if self._count < AT_ONCE:
            again = f"; ask once more to stop at once, which loses {self._loss}"
            _say(f"stopping {self._place}: nothing is lost{again if self._count > 1 else ''}")
        elif not self._held_off:
            raise KeyboardInterrupt

    @contextmanager
    def held_off(self) -> Iterator[None]:
        """Nothing interrupts what is within, such as the writing of a file."""
        self._held_off = True
        try:
            yield
        finally:
            self._held_off = False
        if self._count >= AT_ONCE:
            raise KeyboardInterrupt


@contextmanager
def requests(place: str, loss: str) -> Iterator[StopRequest]:
    """Ctrl-C and SIGTERM within are requests to stop; see `StopRequest`.

    In another thread than the main one signals stay what they are.
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
    # Not through Python's buffers: the signal may have come while they were being written.
    os.write(sys.__stderr__.fileno() if sys.__stderr__ else 2, f"\n{text}\n".encode())
