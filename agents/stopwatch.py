"""The time that a piece of work takes, counted on through stops of any kind."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rimless_gym.checks import not_negative
from trajopt.files import write_text

#: How often the time is written to its file (s); a kill loses at most so much of it.
EVERY = 10.0

FILE = "minutes.json"


def minutes(folder: Path) -> float:
    """The minutes that work in a folder has taken so far."""
    try:
        return not_negative("minutes", json.loads((folder / FILE).read_text()))
    except FileNotFoundError:
        return 0.0
    except (ValueError, TypeError) as error:
        raise ValueError(
            f"{folder / FILE}: damaged ({error}); remove this file: only the count of minutes is "
            "lost"
        ) from error


def forget(folder: Path) -> None:
    """Count from nothing again, for work that begins again."""
    (folder / FILE).unlink(missing_ok=True)


@contextmanager
def timed(folder: Path) -> Iterator[Callable[[], float]]:
    """Count the processor's time of this process within the block to the work in a folder.

    That of other programs on the same cores does not count. The block is given a function that
    tells the minutes of one core so far, those before a stop included.

    Raises:
        ValueError: what was written before is damaged.
        OSError: the folder cannot be written.
    """
    before, begun, over = minutes(folder), time.process_time(), threading.Event()

    def so_far() -> float:
        return before + (time.process_time() - begun) / 60.0

    def write() -> None:
        write_text(folder / FILE, f"{so_far()}\n")

    def keep() -> None:
        while not over.wait(EVERY):
            write()

    thread = threading.Thread(target=keep, daemon=True)
    thread.start()
    try:
        yield so_far
    finally:
        over.set()
        thread.join()
        write()
