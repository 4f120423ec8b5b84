"""How functions are compiled.

Functions that only compiled code calls stay plain Python functions, so Python can call them too.
numba compiles them where compiled code calls them, once per combination of argument types. It omits
the wrappers for calls from Python, which take a third of the compile time. Functions for callers in
Python are `kept`.
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


#: Parts of the package, announced once when they are compiled. One function of each part names it:
#: the one that takes longest, or is compiled first.
ENVIRONMENT = "the simulator for environments (about 15 s)"
ROLLOUTS = "the simulator for roll-outs of policies (about 10 s)"
REFERENCE = "the reference simulator (about 1 s)"


def kept(part: str | None = None, *, nogil: bool = False) -> Callable[[F], Any]:
    """Decorator: compile the function on its first call from Python, and keep the code on disk.

    Args:
        part: part of the package to announce when the function is compiled; None for none.
        nogil: whether other threads may run during a call.
    """

    def decorate(function: F) -> Kept:
        options = {"nopython": True, "error_model": "numpy", "nogil": nogil}
        dispatcher = Kept(function, targetoptions=options)
        dispatcher.part = part
        return dispatcher

    return decorate
