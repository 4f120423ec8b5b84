"""How functions are compiled, and where their machine code is stored.

Functions that only compiled code calls stay plain Python functions, so Python can call them too.
numba compiles them where compiled code calls them, once per combination of argument types. It omits
the wrappers for calls from Python, which take a third of the compile time. Functions for callers in
Python are `cached`: the machine code is stored on disk and loaded by later processes.

numba's own cache writes its index before the code that the index points to, and does not notice
changes of the functions that are compiled in. Here the code of a function, for one processor and
one state of the sources, is a single file, which is either complete or absent.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import pickle
import sys
import uuid
import warnings
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, TypeVar

import numba
from filelock import FileLock
from numba import njit, types
from numba.core.caching import FunctionCache, NullCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps
from numba.core.typing.templates import infer_global

F = TypeVar("F", bound=Callable[..., Any])

#: Parts of the package, announced once when they are compiled. One function of each part names it:
#: the one that takes longest, or is compiled first.
ENVIRONMENT = "the simulator for environments (about 15 s)"
ROLLOUTS = "the simulator for roll-outs of policies (about 10 s)"
REFERENCE = "the reference simulator (about 1 s)"


def _called_from_compiled_code(**options: Any) -> Callable[[F], F]:
    compiled = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)

    def decorate(function: F) -> F:
        function.dispatcher = compiled(function)  # type: ignore[attr-defined]  # kept alive
        infer_global(function, types.Dispatcher(function.dispatcher))  # type: ignore[attr-defined]
        return function

    return decorate


#: Compiled as it stands.
inner = _called_from_compiled_code()

#: The same, but products and sums may be fused: for loops over the lanes of a tile.
vectorised = _called_from_compiled_code(fastmath={"contract"})

#: Like `vectorised`, and always inlined: a loop that contains a call does not vectorise.
inlined = _called_from_compiled_code(fastmath={"contract"}, forceinline=True)


def written(source: str, **names: Any) -> Callable[..., Any]:
    """The function that `source` defines; its code can use `names`.

    It serves for code generated from a layout: a loop over the fields of a tuple does not
    vectorise, but the same lines written out do.
    """
    exec(source, names)
    function: Callable[..., Any] = names[source[len("def ") : source.index("(")]]
    function.__module__ = __name__
    return function


def cached(part: str | None = None, *, nogil: bool = False) -> Callable[[F], Any]:
    """Decorator: compile the function on its first call from Python, and store the code on disk.

    Args:
        part: part of the package to announce when the function is compiled; None for none.
        nogil: whether other threads may run during a call.
    """

    def decorate(function: F) -> CachedFunction:
        options = {"nopython": True, "error_model": "numpy", "nogil": nogil}
        dispatcher = CachedFunction(function, targetoptions=options)
        dispatcher.part = part
        return dispatcher

    return decorate


class CachedFunction(CPUDispatcher):
    """A function that numba compiles and stores on disk.

    Attributes:
        part: what is compiled and how long it takes, announced before; None to announce nothing.
    """

    part: str | None = None
    _cache: Any

    def compile(self, signature: Any) -> Any:
        """Load the machine code for these types of arguments, or compile it.

        One process at a time compiles; the others then load what it has written.
        """
        with global_compiler_lock:
            if type(self._cache) is NullCache:
                try:
                    self._cache = _MachineCode(self.py_func, self.part)
                except RuntimeError:  # numba cannot write to any of its folders
                    _warn_once("every process compiles the simulator again: no folder is writable")
                    return super().compile(signature)
            with self._cache.turn(signature, self.targetctx.codegen()):
                return super().compile(signature)


class _MachineCode(FunctionCache):
    """The machine code of one function, in one file for each combination of argument types."""

    def __init__(self, function: Any, part: str | None) -> None:
        super().__init__(function)
        self._part = part

    def turn(self, signature: Any, codegen: Any) -> AbstractContextManager[Any]:
        """The lock of the process that compiles; none if there is code to load."""
        path = self._path(signature, codegen)
        if _read(path) is None:
            with contextlib.suppress(OSError, NotImplementedError):  # then without a lock
                return _lock(path.with_name("rimless_gym.lock")).acquire()
        return contextlib.nullcontext()

    def _load_overload(self, signature: Any, target_context: Any) -> Any:
        code = _read(self._path(signature, target_context.codegen()))
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
            _warn_once(f"compiled code cannot be stored in {path.parent}: {error.strerror}")
            return
        function, _ = path.name.rsplit("-", 1)
        for other in path.parent.glob(f"{function}-*.nbc"):
            if other != path:  # compiled from other sources
                with contextlib.suppress(OSError):
                    other.unlink()

    def _path(self, signature: Any, codegen: Any) -> Path:
        """The file, named after the function, argument types, processor, versions and sources."""
        name = f"{self._py_func.__module__}.{self._py_func.__qualname__}".replace("<locals>.", "")
        made = signature, codegen.magic_tuple(), numba.__version__, sys.version
        digest = hashlib.sha256(repr(made).encode()).hexdigest()[:16]
        sources = fingerprint("rimless_gym") + fingerprint(self._py_func.__module__.split(".")[0])
        return Path(self.cache_path) / f"{name}-{digest}-{sources}.nbc"


@functools.cache
def fingerprint(package: str) -> str:
    """A digest of a top-level package's sources; of nothing where it has no folder.

    A compiled function may contain functions from any file of this package and of its own, so a
    change in any of them makes it stale.
    """
    folders = [Path(folder) for folder in getattr(sys.modules[package], "__path__", [])]
    sources = [file.read_bytes() for folder in folders for file in sorted(folder.rglob("*.py"))]
    return hashlib.sha256(b"".join(sources)).hexdigest()[:14]


@functools.cache
def _lock(path: Path) -> FileLock:
    return FileLock(path, thread_local=False)  # used under numba's compiler lock, which nests


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
    """What `_write` wrote; None if the file is missing or damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    code = content[32:]
    return code if content[:32] == hashlib.sha256(code).digest() else None


def _write(path: Path, code: bytes) -> None:
    """Write a file so that it is either complete or unchanged."""
    unfinished = path.with_name(f"{path.name}.{uuid.uuid4().hex[:8]}")
    try:
        unfinished.write_bytes(hashlib.sha256(code).digest() + code)
        unfinished.replace(path)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise
