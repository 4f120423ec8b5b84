"""Checks of a whole snapshot before an environment takes anything from it."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from rimless_gym.envs.control import Control
from rimless_gym.envs.disturbances import Disturbances, Ranges
from rimless_gym.envs.layout import MEMORY, columns
from rimless_gym.envs.machines import NUMBERS
from rimless_gym.envs.start_shares import Starts
from rimless_gym.envs.task import Task
from rimless_gym.params import N_CONSTANTS, WheelParams

#: The arrays that a fleet's snapshot copies; its other parts are immutable.
ARRAYS = ("memory", "streams", "held", "constants", "poles", "numbers", "ended")

_SETTINGS = {
    "params": list,
    "ranges": Ranges,
    "disturbances": Disturbances,
    "tasks": list,
    "starts": Starts,
    "control": Control,
}
_FLOAT, _BITS, _BOOL = np.dtype(np.float64), np.dtype(np.uint64), np.dtype(np.bool_)
_SEEN = np.dtype(np.float32)


def require_snapshot(
    state: Any, parts: Collection[str], n: int, control: Control, owner: str
) -> None:
    """Refuse a state that `get_state` of an `owner` with these settings cannot have returned.

    Raises:
        TypeError: it, or a part of it, has the wrong type.
        ValueError: its parts, number of rows n or control differ, or a number in it is not finite.
    """
    remedy = f"give what get_state() of a {owner} returned"
    _require_parts("state", state, parts, remedy)
    fleet, generators = state["fleet"], state["generators"]
    _require_parts("state['fleet']", fleet, (*ARRAYS, *_SETTINGS), remedy)
    for name, kind in _SETTINGS.items():
        if not isinstance(fleet[name], kind):
            raise TypeError(f"state: {name} = {fleet[name]!r}: must be a {kind.__name__}; {remedy}")
    for name, kind in (("params", WheelParams), ("tasks", Task)):
        each = fleet[name]
        if not all(isinstance(one, kind) for one in each):
            raise TypeError(f"state: {name} = {each}: must be {kind.__name__}s; {remedy}")
        if len(each) != n:
            raise ValueError(f"the state is of {len(each)} rows ({name}), not of {n}; {remedy}")
    if fleet["control"] != control:
        raise ValueError(f"the state is of {fleet['control']}, not of {control}")
    if not isinstance(generators, list) or len(generators) != n:
        raise ValueError(f"state: generators = {generators!r}: must be a list of {n}; {remedy}")
    _require_arrays(fleet | state, n, remedy)


def _require_parts(name: str, state: Any, parts: Collection[str], remedy: str) -> None:
    if not isinstance(state, dict):
        raise TypeError(f"{name} = {state!r}: must be a dictionary; {remedy}")
    if state.keys() != set(parts):
        raise ValueError(f"{name} has the parts {list(state)}, must have {list(parts)}; {remedy}")


def _require_arrays(state: dict[str, Any], n: int, remedy: str) -> None:
    """Refuse NaN, and shapes with which compiled code would go out of bounds."""
    each = bool(state["ranges"].bounds) or np.size(state["poles"]) == n
    machines = n if each else 1
    expected = {
        "memory": ((len(MEMORY), columns(n)), _FLOAT),
        "streams": ((n,), _BITS),
        "held": ((state["disturbances"].delays[1] + 1, n), _FLOAT),
        "constants": ((N_CONSTANTS, machines), _FLOAT),
        "poles": ((machines,), _FLOAT),
        "numbers": ((len(NUMBERS), n), _FLOAT),
        "ended": ((n,), _BOOL),
        "seen": ((n, state["control"].width), _SEEN),  # of a vector environment only
    }
    for name in [name for name in expected if name in state]:
        array, (shape, dtype) = state[name], expected[name]
        if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != dtype:
            raise ValueError(
                f"state: {name} = {array!r}: must be an array {shape} of {dtype}; {remedy}"
            )
        finite = np.isfinite(array)
        if name == "memory":  # where there is no target, it is infinite
            finite[MEMORY.target_speed] |= array[MEMORY.target_speed] == np.inf
        wrong = np.argwhere(~finite)
        if len(wrong):
            place = tuple(wrong[0].tolist())
            raise ValueError(
                f"state: {name}{list(place)} = {array[place]}: must be finite; {remedy}"
            )
