"""Validation of the constructor arguments of both environments."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from rimless_gym.envs.control import Control
from rimless_gym.envs.disturbances import Disturbances, Ranges, as_disturbances, as_ranges
from rimless_gym.envs.fleet import Fleet
from rimless_gym.envs.orders import NO_LIMIT
from rimless_gym.envs.plain import made_of
from rimless_gym.envs.start_shares import Starts, as_starts
from rimless_gym.envs.task import USUAL_TASK, Task
from rimless_gym.kernel.stepping import require_steppable
from rimless_gym.params import WheelParams
from rimless_gym.presets import as_params


def as_task(task: Any, present: Task = USUAL_TASK) -> Task:
    """The task, given as such or as a mapping of the fields that differ from the present one's.

    None stands for the present one.

    Raises:
        TypeError: it has the wrong type.
        ValueError: a field is unknown or its value out of range.
    """
    if isinstance(task, Mapping):
        return made_of(Task, "task", dataclasses.asdict(present) | dict(task))
    if not isinstance(task, Task | None):
        raise TypeError(f"task = {task!r}: give a rimless_gym.Task or a dictionary of its fields")
    return task or present


def tasks_of(task: Any, present: Sequence[Task]) -> list[Task]:
    """`task`, one for all rows or one per row, as a list; mappings change the present tasks.

    Raises:
        TypeError: a task has the wrong type.
        ValueError: there is not one task per row, or a field is unknown or out of its range.
    """
    each = list(task) if isinstance(task, (list, tuple)) else [task] * len(present)
    if len(each) != len(present):
        raise ValueError(f"task: {len(each)} tasks for {len(present)} rows, must be one per row")
    return [as_task(*one) for one in zip(each, present, strict=True)]


def require_render_mode(render_mode: Any, render_modes: Sequence[str]) -> None:
    """Refuse a render mode that an environment does not have.

    Raises:
        ValueError: it is neither one of them nor None.
    """
    if render_mode is not None and render_mode not in render_modes:
        raise ValueError(f"render_mode = {render_mode!r}: choose from {render_modes} or None")


def machines_of(params: Any, n: int) -> list[WheelParams]:
    """`params`, one for all or one per row, as a list of N.

    Raises:
        TypeError: a machine has the wrong type.
        ValueError: there is not one machine per row, or one is invalid or cannot be stepped.
    """
    each = list(map(as_params, params)) if isinstance(params, (list, tuple)) else None
    if each is None:
        each = [as_params(params)] * n
    if len(each) != n:
        raise ValueError(f"params: {len(each)} machines for {n} rows, must be one per row")
    for machine in dict.fromkeys(each):
        require_steppable(machine)
    return each


def require_valid(ranges: Ranges, params: Sequence[WheelParams]) -> None:
    """Refuse ranges whose ends are not valid for one of the machines.

    Raises:
        ValueError: see `WheelParams`.
    """
    if ranges.bounds:
        for machine in dict.fromkeys(params):
            ranges.require_valid(machine)


def fleet_of(
    params: Sequence[WheelParams],
    task: Task,
    ranges: Ranges | Mapping[str, Any] | None,
    disturbances: Disturbances | Mapping[str, Any] | None,
    control: Control,
    starts: Starts | Mapping[str, Any] | None,
    num_threads: int = 1,
    limit: int = NO_LIMIT,
) -> Fleet:
    """The rows of an environment.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: the machines cannot be stepped with the ends of the ranges.
    """
    drawn = as_ranges(ranges)
    require_valid(drawn, params)
    disturbed = as_disturbances(disturbances)
    return Fleet(params, task, drawn, disturbed, control, as_starts(starts), num_threads, limit)
