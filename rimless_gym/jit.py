"""How functions are compiled, and where their machine code is stored.

Functions that only compiled code calls stay plain Python functions, so Python can call them too.
numba compiles them where compiled code calls them, once per combination of argument types. It omits
the wrappers for calls from Python, which take a third of the compile time, and machine code of
their own, which takes a seventh: callers are linked with their LLVM code. The type of each call is
found once, not each time. Functions for callers in Python are `cached`: the machine code is stored
on disk and loaded by later processes.

numba's own cache does not notice changes of the functions that are compiled in, so here its files
are named after all sources.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import hashlib
import os
import pickle
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from filelock import FileLock
from numba import config, njit, types
from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.typed_passes import InlineOverloads, NopythonRewrites
from numba.core.typing.context import Context
from numba.core.typing.templates import infer_global
from numba.core.untyped_passes import DeadBranchPrune, InlineClosureLikes, WithLifting

if config.DISABLE_JIT:
    raise ValueError("NUMBA_DISABLE_JIT is set: the simulator runs only compiled; unset it")

F = TypeVar("F", bound=Callable[..., Any])

#: Parts of the package, announced once when they are compiled. One function of each part names it:
#: the one that takes longest, or is compiled first.
SIMULATOR = "the simulator (about 9 s)"
ENVIRONMENT = "the environments (about 2 s)"
REFERENCE = "the reference simulator (about 1 s)"


#: New objects between two garbage collections while numba compiles, which leaves hardly any.
GARBAGE = 20_000

#: Passes for what loops over the lanes of a tile do not have: closures, array expressions, objects.
_UNUSED = {DeadBranchPrune, InlineClosureLikes, InlineOverloads, NopythonRewrites, WithLifting}


class _Types(Context):
    """Types of calls, each found once: numba tries a dozen signatures for every product."""

    found: dict[Any, Any]

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """The signature of a call; of one by name, such as "static_getitem", found every time."""
        if kws or isinstance(func, str):
            return super().resolve_function_type(func, args, kws)
        call = func, tuple(args)
        if call not in self.found:
            self.found[call] = super().resolve_function_type(func, args, kws)
        return self.found[call]


@functools.cache
def _remembering(typing: Context) -> _Types:
    types = object.__new__(_Types)
    types.__dict__ = typing.__dict__
    types.found = {}
    return types


class _Remembering(Compiler):
    """numba's compiler, with `_Types`."""

    def __init__(self, typing: Context, *arguments: Any) -> None:
        super().__init__(_remembering(typing), *arguments)


class _LinkedCode(JITCodeLibrary):
    """LLVM code of a function, for its callers; no machine code is made of it."""

    @property
    def codegen(self) -> _LinkedCode:
        """Where numba sets what the machine code needs."""
        return self

    def set_env(self, name: str, env: Any) -> None:
        """Nothing needs it."""

    def get_pointer_to_function(self, name: str) -> int:
        """0: there is none."""
        self._ensure_finalized()
        return 0

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _Linked(_Remembering):
    """Compiles to `_LinkedCode`."""

    def __init__(self, typing: Any, target: Any, library: Any, *arguments: Any) -> None:
        library = library or _LinkedCode(target.codegen(), "linked")
        super().__init__(typing, target, library, *arguments)


class _OfLanes(_Linked):
    """Compiles loops over the lanes of a tile."""

    def define_pipelines(self) -> list[Any]:
        """numba's passes without `_UNUSED`."""
        (pipeline,) = super().define_pipelines()
        pipeline.passes = [one for one in pipeline.passes if one[0] not in _UNUSED]
        return [pipeline]


def _called_from_compiled_code(compiler: type[_Linked], **options: Any) -> Callable[[F], F]:
    wrappers = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    compiled = njit(error_model="numpy", pipeline_class=compiler, **wrappers, **options)

    def decorate(function: F) -> F:
        function.dispatcher = compiled(function)  # type: ignore[attr-defined]  # kept alive
        infer_global(function, types.Dispatcher(function.dispatcher))  # type: ignore[attr-defined]
        return function

    return decorate


#: Compiled as it stands.
inner = _called_from_compiled_code(_Linked)

#: The same, but products and sums may be fused: for loops over the lanes of a tile. They allocate
#: no arrays, so that references to them need not be counted.
vectorised = _called_from_compiled_code(_OfLanes, fastmath={"contract"}, _nrt=False)

#: Like `vectorised`, and always inlined: a loop that contains a call does not vectorise.
inlined = _called_from_compiled_code(_OfLanes, fastmath={"contract"}, _nrt=False, forceinline=True)


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
        options = {"nopython": True, "error_model": "numpy", "no_cfunc_wrapper": True}
        options["nogil"] = nogil
        dispatcher = CachedFunction(function, {}, options, _Remembering)
        dispatcher.part = part
        return dispatcher

    return decorate


class CachedFunction(CPUDispatcher):
    """A function that numba compiles and stores on disk; `part` is announced before."""

    part: str | None = None
    _cache: Any

    def compile(self, signature: Any) -> Any:
        """Load the machine code for these types of arguments, or compile it.

        One process at a time compiles; the others then load what it has written.
        """
        with global_compiler_lock, contextlib.ExitStack() as turn:
            if type(self._cache) is NullCache:
                try:
                    self._cache = _MachineCode(self.py_func, self.part)
                except RuntimeError:  # numba cannot write to any of its folders
                    _warn_once("every process compiles the simulator again: no folder is writable")
            self._cache.turn = turn
            turn.callback(gc.set_threshold, *gc.get_threshold())
            gc.set_threshold(GARBAGE)
            return super().compile(signature)


class _MachineCode(FunctionCache):
    """numba's cache of one function, in files that belong to one state of the sources."""

    turn: contextlib.ExitStack  # holds the lock between processes while it is compiled

    def __init__(self, function: Any, part: str | None) -> None:
        super().__init__(function)
        self._sources = fingerprint("rimless_gym") + fingerprint(function.__module__.split(".")[0])
        name = f"{self._impl.filename_base}-{self._sources}"
        self._cache_file = IndexDataCacheFile(self.cache_path, name, self._sources)
        self._part = part

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """The stored code, or None if there is none; it then is this process's turn to compile."""
        for attempt in range(2):
            try:
                code = super().load_overload(signature, target_context)
            except (EOFError, pickle.UnpicklingError):  # a damaged file
                self._cache_file.flush()
                code = None
            if code is not None:
                return code
            if attempt == 0:  # another process may write it while this one waits
                path = Path(self.cache_path, "rimless_gym.lock")
                with contextlib.suppress(OSError, NotImplementedError):  # then without a lock
                    self.turn.enter_context(_lock(path, os.getpid()))
        _announce(self._part)
        return None

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """Store the code; what was compiled from other sources is deleted."""
        try:
            super().save_overload(signature, compiled)
        except OSError as error:
            _warn_once(f"compiled code cannot be stored in {self.cache_path}: {error.strerror}")
        function, _ = self._impl.filename_base.rsplit("-", 1)
        for file in Path(self.cache_path).glob(f"{function}-*.nb[ic]"):
            if self._sources not in file.name:
                with contextlib.suppress(OSError):
                    file.unlink()


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
def _lock(path: Path, process: int) -> FileLock:
    """The lock of one process: filelock refuses one that was inherited across a fork."""
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
