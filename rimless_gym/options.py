"""What `reset(options=...)` takes, for one row or many, validated before anything changes."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rimless_gym.params import WheelParams
from rimless_gym.starts import DRAWN, GIVEN, HANGING
from rimless_gym.stepping import MODE, STATE_SIZE, require_steppable
from rimless_gym.task import normal_force
from rimless_gym.trajectory import validated_start

NAMES = ("state", "mode", "params")


@dataclasses.dataclass(frozen=True)
class Options:
    """Reset options, one value per row that is reset.

    Attributes:
        params: the machines, or None where they stay.
        kind: of start, see `rimless_gym.starts`.
        given: (phi, theta, phi', theta', mode) per row, (K, 5); empty unless `kind` is GIVEN.
    """

    params: list[WheelParams] | None
    kind: int
    given: NDArray[np.float64]


def read(options: dict[str, Any] | None, current: Sequence[WheelParams]) -> Options:
    """The options for the rows whose machines are `current`.

    Raises:
        ValueError: an option is unknown or its value out of range.
    """
    options = options or {}
    for name in options:
        if name not in NAMES:
            raise ValueError(f"unknown reset option {name!r}: choose from {NAMES}")
    params = machines(options["params"], len(current)) if "params" in options else None
    if "state" in options:
        modes = options.get("mode", "single_stance")
        given = _states(options["state"], modes, params or current)
        return Options(params, GIVEN, given)
    nothing = np.empty((0, STATE_SIZE - 1))
    if "mode" not in options:
        return Options(params, DRAWN, nothing)
    if options["mode"] != "double_stance":
        raise ValueError("reset option 'mode' goes with 'state', unless it is 'double_stance'")
    return Options(params, HANGING, nothing)


def machines(params: Any, n: int) -> list[WheelParams]:
    """`params`, one for all or one per row, as a list of N.

    Raises:
        ValueError: it is neither, or one of them cannot be stepped.
    """
    each = [params] * n if isinstance(params, WheelParams) else params
    if not isinstance(each, (list, tuple)) or not all(isinstance(p, WheelParams) for p in each):
        raise ValueError(f"params = {params!r}: give a WheelParams, or a list of one per row")
    if len(each) != n:
        raise ValueError(f"params: {len(each)} machines for {n} rows, must be one per row")
    for machine in dict.fromkeys(each):
        require_steppable(machine)
    return list(each)


def _states(states: Any, modes: Any, params: Sequence[WheelParams]) -> NDArray[np.float64]:
    """Given states, one for all rows or one per row, with their modes: (N, 5)."""
    n = len(params)
    many = np.ndim(states) == 2
    if many and len(states) != n:
        raise ValueError(f"state: {len(states)} states for {n} rows, must be one per row")
    if not isinstance(modes, str) and len(modes) != n:
        raise ValueError(f"mode: {len(modes)} modes for {n} rows, must be one per row")
    given = np.empty((n, STATE_SIZE - 1))
    for i, machine in enumerate(params):
        x, mode = states[i] if many else states, modes if isinstance(modes, str) else modes[i]
        given[i, :4], given[i, MODE] = validated_start(machine, x, mode, "state")
        force = normal_force(machine, given[i])
        if force <= 0:
            raise ValueError(
                f"state = {x!r}: without voltage the ground would have to pull the foot "
                f"({force:.3g} N); give a slower state"
            )
    return given
