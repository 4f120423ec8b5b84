"""`reset(options=...)` for one row or many, validated before anything changes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rimless_gym.checks import real_array
from rimless_gym.envs.arguments import machines_of, require_valid, tasks_of
from rimless_gym.envs.control import as_speeds
from rimless_gym.envs.disturbances import Disturbances, Ranges, as_disturbances, as_ranges
from rimless_gym.envs.fleet import Fleet
from rimless_gym.envs.start_shares import Starts, as_starts
from rimless_gym.envs.starts import DRAWN, GIVEN, HANGING, normal_force
from rimless_gym.envs.task import Task
from rimless_gym.kernel.stepping import MODE, STATE_SIZE
from rimless_gym.params import WheelParams
from rimless_gym.trajectory import validated_start

NAMES = ("state", "mode", "params", "task", "starts", "ranges", "disturbances")
_FOR_ALL = ("starts", "ranges", "disturbances")


@dataclasses.dataclass(frozen=True)
class Options:
    """How the next episodes of some rows begin.

    Attributes:
        rows: the rows that begin an episode, K of N.
        params: the machines of all rows, or None to keep them and the ranges.
        ranges: the ranges of all rows.
        tasks: the tasks of all rows, or None to keep them.
        starts: the shares of the kinds of start in all rows.
        disturbances: the disturbances of all rows, or None to keep them.
        kind: kind of start; see `rimless_gym.envs.starts`.
        speeds: commanded speed of each of `rows` (m/s), (K,); None to draw them.
        given: (phi, theta, phi', theta', mode) per row, (K, 5); empty unless `kind` is GIVEN.
    """

    rows: NDArray[np.int64]
    params: list[WheelParams] | None
    ranges: Ranges
    tasks: list[Task] | None
    starts: Starts
    disturbances: Disturbances | None
    kind: int
    speeds: NDArray[np.float64] | None
    given: NDArray[np.float64]

    def apply(self, fleet: Fleet) -> None:
        """Set the fleet's machines, tasks, ranges, starts and disturbances."""
        fleet.starts = self.starts
        if self.tasks is not None:
            fleet.set_tasks(self.tasks, self.rows)
        if self.params is not None:
            fleet.set_machines(self.params, self.ranges, self.rows)
        if self.disturbances is not None:
            fleet.set_disturbances(self.disturbances)


def read(options: Mapping[str, Any] | None, fleet: Fleet, rows: NDArray[np.int64]) -> Options:
    """The options for `rows` of a fleet, checked; the fleet is not changed.

    Raises:
        TypeError: a value has the wrong type.
        ValueError: an option is unknown or its value out of range, or starts, ranges or
            disturbances, which hold for all rows, are given for some.
    """
    options = options or {}
    names = NAMES if fleet.control.speeds is None else (*NAMES, "speed")
    for name in options:
        if name not in names:
            raise ValueError(f"unknown reset option {name!r}: choose from {names}")
        if name in _FOR_ALL and len(rows) < len(fleet):
            raise ValueError(f"reset option {name!r} holds for all rows: give no reset_mask")
    params = list(fleet.params)
    if "params" in options:
        for i, machine in zip(rows, machines_of(options["params"], len(rows)), strict=True):
            params[i] = machine
    tasks = list(fleet.tasks) if "task" in options else None
    if tasks is not None:
        chosen = tasks_of(options["task"], [tasks[i] for i in rows])
        for i, task in zip(rows, chosen, strict=True):
            tasks[i] = task
        fleet.require_payable(tasks)
    starts = as_starts(options["starts"]) if "starts" in options else fleet.starts
    ranges = as_ranges(options["ranges"]) if "ranges" in options else fleet.ranges
    same = "params" not in options and "ranges" not in options
    if not same:
        require_valid(ranges, params)
    disturbances = as_disturbances(options["disturbances"]) if "disturbances" in options else None
    speeds = as_speeds("speed", options["speed"], len(rows)) if "speed" in options else None
    kind, given = DRAWN, np.empty((0, STATE_SIZE - 1))
    if "state" in options:
        modes = options.get("mode", "single_stance")
        kind, given = GIVEN, _states(options["state"], modes, [params[i] for i in rows])
    elif "mode" in options:
        if not (isinstance(options["mode"], str) and options["mode"] == "double_stance"):
            raise ValueError(
                f"reset option 'mode' = {options['mode']!r}: goes with 'state', unless it is "
                "'double_stance'"
            )
        kind = HANGING
    machines = None if same else params
    return Options(rows, machines, ranges, tasks, starts, disturbances, kind, speeds, given)


def masked(mask: Any, n: int, name: str = "reset_mask") -> NDArray[np.int64]:
    """Indices of the rows, out of N, that the mask `name` marks; of all without a mask.

    Raises:
        TypeError: it is not an array of bool.
        ValueError: it has the wrong shape, or marks no row.
    """
    if mask is None:
        return np.arange(n)
    if not (isinstance(mask, np.ndarray) and mask.dtype == np.bool_):
        raise TypeError(f"{name} = {mask!r}: must be a NumPy array of bool")
    if mask.shape != (n,) or not mask.any():
        raise ValueError(f"{name} = {mask}: must have shape ({n},) and mark a row")
    return np.flatnonzero(mask)


def _states(states: Any, modes: Any, params: Sequence[WheelParams]) -> NDArray[np.float64]:
    """Given states, one for all rows or one per row, with their modes: (N, 5)."""
    n = len(params)
    many = real_array("state", states).ndim == 2
    if not isinstance(modes, str) and np.ndim(modes) != 1:
        raise TypeError(f"mode = {modes!r}: give a name, or one per row")
    if many and len(states) != n:
        raise ValueError(f"state: {len(states)} states for {n} rows, must be one per row")
    if not isinstance(modes, str) and len(modes) != n:
        raise ValueError(f"mode: {len(modes)} modes for {n} rows, must be one per row")
    if many or not isinstance(modes, str):
        each = states if many else [states] * n
        named = [modes] * n if isinstance(modes, str) else modes
        return np.array([_start(*one) for one in zip(params, each, named, strict=True)])
    starts = {machine: _start(machine, states, modes) for machine in dict.fromkeys(params)}
    return np.array([starts[machine] for machine in params])


def _start(params: WheelParams, x: ArrayLike, mode: str) -> NDArray[np.float64]:
    start = np.empty(STATE_SIZE - 1)
    start[:4], start[MODE] = validated_start(params, x, mode, "state")
    limit = params.voltage_limit
    force = normal_force(params, start, limit)
    if force <= 0:
        raise ValueError(
            f"state = {x!r}: no voltage from {-limit:g} to {limit:g} V presses the foot on the "
            f"ground; the largest force is {force:.3g} N and must be greater than 0: give a slower "
            "state"
        )
    return start
