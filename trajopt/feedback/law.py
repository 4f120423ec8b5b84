"""What a feedback law is: a voltage for every state.

A law that holds a gait is one compiled function of the state and of its own numbers (`Law`). A
start-up controller (`trajopt.feedback.startup`) and a contact guard (`trajopt.feedback.controller`)
are put around it.
"""

from __future__ import annotations

import dataclasses
import functools
import reprlib
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from rimless_gym.checks import positive, real_array, require_kind
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.jit import cached
from rimless_gym.params import WheelParams
from rimless_gym.presets import machine_name

Floats: TypeAlias = NDArray[np.float64]

#: Largest angle (rad) and rate (rad/s) of a state.
LARGEST = 1e6

#: (x (N, 4), mode (N,)) -> V (N,): a voltage (V) for each state (phi, theta, phi', theta') and
#: stance mode (`rimless_gym.equations.SINGLE` or `DOUBLE`).
Controller: TypeAlias = Callable[[Floats, NDArray[np.int64]], Floats]


@dataclasses.dataclass(frozen=True, repr=False)
class Law:
    """A law that holds a gait: a compiled function of the state, without memory.

    Attributes:
        params: the machine.
        volts: (x (4,), mode, data) -> V; a `rimless_gym.jit.inner` function.
        data: what it needs besides the state, a NamedTuple of arrays and numbers; `data.orbit` is
            the gait's `trajopt.feedback.orbit.Orbit`.
        smooth: whether the voltage has a derivative by the state on the gait; the best of several
            candidates has none.
        reach: multiplies the distance from its gait up to which it acts
            (`trajopt.feedback.startup.near_for`); > 0.

    Raises:
        TypeError: `volts` is not compiled, or `data` has no orbit.
        ValueError: `reach` is not positive.
    """

    params: WheelParams
    volts: Callable[[Any, Any, Any], Any]
    data: Any
    smooth: bool = True
    reach: float = 1.0

    def __post_init__(self) -> None:
        require_kind("params", self.params, WheelParams)
        positive("reach", self.reach)
        if not hasattr(self.volts, "dispatcher"):
            raise TypeError(
                f"volts = {reprlib.repr(self.volts)}: must be compiled; put @inner of "
                "rimless_gym.jit above its def"
            )
        if not hasattr(self.data, "orbit"):
            raise TypeError(
                f"data = {reprlib.repr(self.data)}: has no field orbit; add one, with "
                "trajopt.feedback.orbit.Grid.of(solution).orbit()"
            )

    def __repr__(self) -> str:
        name = f"{self.volts.__module__}.{self.volts.__name__}"
        nodes = len(self.data.orbit.states)
        return f"Law({machine_name(self.params)}, {name}, orbit of {nodes} nodes)"

    @property
    def compiled(self) -> Any:
        """`volts`, for compiled code that is given it as an argument."""
        return self.volts.dispatcher  # type: ignore[attr-defined]

    def __call__(self, x: ArrayLike, mode: ArrayLike = SINGLE) -> Floats:
        """Voltages for states.

        Args:
            x: states, shape (N, 4) or (4,).
            mode: stance modes, shape (N,), or one for all states.

        Returns:
            Volts within the limit, shape (N,) or ().

        Raises:
            TypeError: the states or modes are not real numbers.
            ValueError: they have another shape, a state is not finite or larger than `LARGEST`, or
                a mode is neither SINGLE nor DOUBLE.
        """
        states, modes = states_and_modes(x, mode)
        limit = self.params.voltage_limit
        volts: Floats = _voltages(self.volts)(states, modes, self.data, limit)
        return volts if np.ndim(x) == 2 else volts[0]


@functools.cache
def _voltages(law: Callable[[Any, Any, Any], Any]) -> Any:
    """A law's function of many states; that of a law from here is stored on disk."""

    def voltages(x, mode, data, limit):  # type: ignore[no-untyped-def]
        volts = np.empty(len(x))
        for i in range(len(x)):
            volts[i] = min(max(law(x[i], mode[i], data), -limit), limit)
        return volts

    ours = law.__module__.split(".")[0] == __name__.split(".")[0]  # else its changes pass unnoticed
    return cached()(voltages) if ours else njit(error_model="numpy")(voltages)


def states_and_modes(x: ArrayLike, mode: ArrayLike) -> tuple[Floats, NDArray[np.int64]]:
    """The arguments of a law, as contiguous states (N, 4) and modes (N,)."""
    states = np.atleast_2d(real_array("x", x))
    if states.ndim != 2 or states.shape[1] != 4:
        raise ValueError(f"x: has shape {np.shape(x)}; must have shape (4,) or (N, 4)")
    if not (np.abs(states) <= LARGEST).all():
        raise ValueError(
            f"x: has {states[~(np.abs(states) <= LARGEST)][0]}; angles (rad) and rates (rad/s) "
            f"must be at most {LARGEST:g} in size, where angles still have their digits"
        )
    modes = real_array("mode", mode)
    if modes.shape not in ((), (1,), (len(states),)):
        raise ValueError(f"mode: has shape {modes.shape}; must have shape () or ({len(states)},)")
    if not np.isin(modes, (SINGLE, DOUBLE)).all():
        raise ValueError(
            f"mode = {mode!r}: must be {SINGLE} (single stance) or {DOUBLE} (double stance)"
        )
    contiguous = np.ascontiguousarray(states, dtype=np.float64)
    return contiguous, np.broadcast_to(modes.astype(np.int64), len(states))


def require_machine(name: str, made: Any, params: WheelParams) -> None:
    """Refuse a controller made for other parameters, if it knows them, with a ValueError."""
    known = getattr(made, "params", params)
    if isinstance(known, WheelParams) and known != params:
        raise ValueError(
            f"{name}: made for another machine: {known.differences(params)}; make it for this one"
        )
