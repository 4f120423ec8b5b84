"""What the constructors of both environments take, validated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rimless_gym.envs.disturbances import Disturbances, Ranges, as_disturbances, as_ranges
from rimless_gym.envs.fleet import Fleet
from rimless_gym.envs.interval import NO_LIMIT
from rimless_gym.envs.task import Task
from rimless_gym.kernel.stepping import require_steppable
from rimless_gym.params import WheelParams


def check_arguments(params: Any, task: Any, render_mode: Any, render_modes: list[str]) -> None:
    """Refuse what neither environment takes.

    Raises:
        TypeError: `params` or `task` is of another type.
        ValueError: there is no such render mode.
    """
    for machine in params if isinstance(params, (list, tuple)) else [params]:
        if not isinstance(machine, WheelParams):
            raise TypeError(
                f"params = {machine!r}: give a WheelParams, e.g. rimless_gym.preset('PROTOTYPE')"
            )
    if task is not None and not isinstance(task, Task):
        raise TypeError(f"task = {task!r}: give a rimless_gym.Task")
    if render_mode is not None and render_mode not in render_modes:
        raise ValueError(f"render_mode = {render_mode!r}: choose from {render_modes} or None")


def machines_of(params: Any, n: int) -> list[WheelParams]:
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


def require_valid(ranges: Ranges, params: Sequence[WheelParams]) -> None:
    """Refuse ranges whose ends one of the machines cannot have.

    Raises:
        ValueError: see `WheelParams`.
    """
    if ranges.bounds:
        for machine in dict.fromkeys(params):
            ranges.require_valid(machine)


def fleet_of(
    params: Sequence[WheelParams],
    task: Task,
    ranges: Ranges | Mapping[str, tuple[float, float]] | None,
    disturbances: Disturbances | None,
    num_threads: int = 1,
    limit: int = NO_LIMIT,
) -> Fleet:
    """The rows of an environment.

    Raises:
        TypeError: an argument is of another type.
        ValueError: a machine cannot be stepped, or not with the ends of the ranges.
    """
    drawn, machines = as_ranges(ranges), machines_of(list(params), len(params))
    require_valid(drawn, machines)
    return Fleet(machines, task, drawn, as_disturbances(disturbances), num_threads, limit)
