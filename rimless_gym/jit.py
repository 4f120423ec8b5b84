"""How functions are compiled.

Functions that only compiled code calls stay plain Python functions, so Python may call them too.
numba compiles them where compiled code calls them, once per combination of argument types, without
the wrappers for calls from Python, which take a third of the compile time. Functions that Python
calls are `kept`.
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

#: May fuse products and sums: for loops over the lanes of a tile.
vectorised = _called_from_compiled_code(fastmath={"contract"})

#: The same, always part of its caller: a loop with a call in it would not vectorise.
inlined = _called_from_compiled_code(fastmath={"contract"}, forceinline=True)


def written(source: str, **names: Any) -> Callable[..., Any]:
    """The function that `source` defines, whose lines depend on a layout; it knows `names`.

    Loops over the fields of a tuple do not vectorise, and the same lines written out do.
    """
    exec(source, names)
    function: Callable[..., Any] = names[source[len("def ") : source.index("(")]]
    function.__module__ = __name__
    return function


#: What is announced when a part of the package is compiled, once: the function of that part that
#: takes longest, or is compiled first, names it.
ENVIRONMENT = "the simulator for environments (about 15 s)"
ROLLOUTS = "the simulator for roll-outs of policies (about 10 s)"
REFERENCE = "the reference simulator (about 1 s)"


def kept(part: str | None = None, *, nogil: bool = False) -> Callable[[F], Any]:
    """Compiled when it is first called, for callers in Python, and kept on disk.

    Args:
        part: of the package, announced when this is compiled; None to announce nothing.
        nogil: whether other threads run meanwhile.
    """

    def decorate(function: F) -> Kept:
        options = {"nopython": True, "error_model": "numpy", "nogil": nogil}
        dispatcher = Kept(function, targetoptions=options)
        dispatcher.part = part
        return dispatcher

    return decorate
