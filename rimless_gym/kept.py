"""Compiled functions whose machine code is kept on disk: each is compiled once, by one process.

numba's own cache writes its index before the code that the index points to. If a process is killed
in between, or another one reads meanwhile, stale code can be loaded. Here the code of a function,
for one machine and one state of the sources, is a single file, which is either complete or absent.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import pickle
import stat
import sys
import uuid
import warnings
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache, NullCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps

from rimless_gym.fingerprint import SOURCE_FINGERPRINT, package_fingerprint
from rimless_gym.turns import Turn

_TURN = Turn()  # used by one thread at a time, under numba's compiler lock
_DIGEST_SIZE = hashlib.sha256().digest_size


class Kept(CPUDispatcher):
    """A function that numba compiles and keeps on disk.

    Attributes:
        part: what is compiled and how long it takes, announced before; None to announce nothing.
    """

    part: str | None = None
    _cache: Any

    def compile(self, signature: Any) -> Any:
        """Load the machine code for these types of arguments, or compile it.

        One process at a time compiles; the others then load what it has written.
        """
        with global_compiler_lock, _TURN:
            if type(self._cache) is NullCache:
                self._cache = _cache_of(self.py_func, self.part)
            return super().compile(signature)


def _cache_of(function: Any, part: str | None) -> MachineCode | Nowhere:
    try:
        return MachineCode(function, part)
    except RuntimeError:  # numba cannot write to any of its folders
        return Nowhere()


class MachineCode(FunctionCache):
    """The machine code of one function, in one file for each combination of argument types."""

    def __init__(self, function: Any, part: str | None) -> None:
        super().__init__(function)
        self._part = part

    def _load_overload(self, signature: Any, target_context: Any) -> Any:
        path = self._path(signature, target_context.codegen())
        code = _read(path)
        if code is None:
            _TURN.take(path.with_name("rimless_gym.lock"))
            code = _read(path)  # another process may have written it while this one waited
        if code is None:
            _announce(self._part)
            return None
        return self._impl.rebuild(target_context, pickle.loads(code))

    def _save_overload(self, signature: Any, compiled: Any) -> None:
        if not self._impl.check_cachable(compiled):
            return
        path = self._path(signature, compiled.codegen)
        try:
            _write(path, dumps(self._impl.reduce(compiled)))
        except OSError as error:
            _warn_once(f"the compiled simulator cannot be kept in {path.parent}: {error.strerror}")
            return
        machine, _ = path.name.rsplit("-", 1)
        for other in path.parent.glob(f"{machine}-*.nbc"):
            if other != path:  # compiled from other sources
                with contextlib.suppress(OSError):
                    other.unlink()

    def _path(self, signature: Any, codegen: Any) -> Path:
        """The file, named after the function, argument types, machine, versions and sources."""
        name = f"{self._py_func.__module__}.{self._py_func.__qualname__}".replace("<locals>.", "")
        made = signature, codegen.magic_tuple(), numba.__version__, sys.version
        digest = hashlib.sha256(repr(made).encode()).hexdigest()[:16]
        own = package_fingerprint(self._py_func.__module__.partition(".")[0])
        return Path(self.cache_path) / f"{name}-{digest}-{SOURCE_FINGERPRINT:x}{own:x}.nbc"


class Nowhere(NullCache):
    """Keeps nothing, and says so in a warning."""

    def load_overload(self, signature: Any, target_context: Any) -> None:
        """Warn, and return None so that numba compiles."""
        _warn_once(
            "every process compiles the simulator again, which takes about 15 s: neither the "
            "package's folder nor a cache in the home folder is writable"
        )


@functools.cache
def _announce(part: str | None) -> None:
    if part is not None:
        print(f"rimless_gym: compiling {part}, once for this machine", file=sys.stderr, flush=True)


@functools.cache
def _warn_once(trouble: str) -> None:
    text = f"{trouble}; set NUMBA_CACHE_DIR to a folder of your own"
    # Not attributed to a file, so that no source line is printed below the warning.
    warnings.warn_explicit(text, RuntimeWarning, "rimless_gym", 0)


def _read(path: Path) -> bytes | None:
    """What `_write` wrote; None if the file is missing, damaged, or may be somebody else's."""
    try:
        with path.open("rb") as file:
            if not _is_ours(os.fstat(file.fileno())):
                return None
            content = file.read()
    except OSError:
        return None
    code = content[_DIGEST_SIZE:]
    return code if content[:_DIGEST_SIZE] == hashlib.sha256(code).digest() else None


def _is_ours(status: os.stat_result) -> bool:
    """Whether only this user or root can have written a file: loading machine code runs it."""
    if not hasattr(os, "getuid"):
        return True
    return status.st_uid in (os.getuid(), 0) and not status.st_mode & stat.S_IWOTH


def _write(path: Path, code: bytes) -> None:
    """Write a file so that it is either complete or unchanged."""
    unfinished = path.with_name(f"{path.name}.{uuid.uuid4().hex[:8]}")
    try:
        unfinished.write_bytes(hashlib.sha256(code).digest() + code)
        unfinished.replace(path)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise
