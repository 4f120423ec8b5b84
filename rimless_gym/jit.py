"""How functions are compiled.

Those that compiled code alone calls stay plain Python functions, which Python may call; numba
compiles them where compiled code calls them, once for each types of arguments, without the wrappers
for calls from Python, which take a third of the time of compiling. What Python calls is `kept`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from numba import njit, types
from numba.core.typing.templates import infer_global

from rimless_gym.kept import Kept

F = TypeVar("F", bound=Callable[..., Any])


def _called_from_compiled_code(**options: Any) -> Callable[[F], F]:
    compiled = njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)

    def decorate(function: F) -> F:
        function.dispatcher = compiled(function)  # type: ignore[attr-defined]  # kept alive
        infer_global(function, types.Dispatcher(function.dispatcher))  # type: ignore[attr-defined]
        return function

    return decorate


#: Compiled as it stands.
inner = _called_from_compiled_code()

#: May fuse products and sums, as loops over the lanes of a tile do.
vectorised = _called_from_compiled_code(fastmath={"contract"})

#: The same, always part of its caller: a loop with a call in it would not vectorise.
inlined = _called_from_compiled_code(fastmath={"contract"}, forceinline=True)

#: What is announced, by what takes longest of it or comes first: one process compiles that.
ENVIRONMENT = "the simulator (about 15 s)"
REFERENCE = "the reference simulator (about 1 s)"


def kept(part: str | None = None, *, nogil: bool = False) -> Callable[[F], Any]:
    """Compiled when it is first called, for callers in Python, and kept on disk.

    Args:
        part: of the package, to be announced when this is compiled; None: nothing is said.
        nogil: whether other threads run meanwhile.
    """

    def decorate(function: F) -> Kept:
        options = {"nopython": True, "error_model": "numpy", "nogil": nogil}
        dispatcher = Kept(function, targetoptions=options)
        dispatcher.part = part
        return dispatcher

    return decorate
