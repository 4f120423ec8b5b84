"""Taking turns between processes that would otherwise do the same work at the same time."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from types import TracebackType
from typing import IO, Any

if sys.platform == "win32":
    import errno
    import msvcrt
    import time

    def _lock(file: IO[Any]) -> None:
        while True:
            try:
                return msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
            except OSError as error:
                if error.errno != errno.EACCES:
                    raise
            time.sleep(0.1)

else:
    import fcntl

    def _lock(file: IO[Any]) -> None:
        # lockf, not flock: a forked child does not hold it.
        fcntl.lockf(file, fcntl.LOCK_EX)


class Turn:
    """A lock between processes that a ``with`` block may take at any point and releases at its end.

    The ``with`` may be nested: the outermost one releases. If the process is killed, the operating
    system releases the lock.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._file: IO[Any] | None = None

    def __enter__(self) -> None:
        self._depth += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._depth -= 1
        if self._depth == 0 and self._file is not None:
            self._file.close()
            self._file = None

    def take(self, path: Path) -> None:
        """Wait until no other process holds `path`, a file that is created and left in place.

        If the file cannot be written or locked, this returns at once without the lock.
        """
        if self._file is not None:
            return
        with contextlib.suppress(OSError):
            self._file = path.open("ab")
            _lock(self._file)
