"""Many wheels and their episodes: what both environments are built on.

The single environment is a fleet of one. Every row is computed by the same compiled functions,
with the same results, however many rows there are.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rimless_gym.envs.control import USUAL, Control
from rimless_gym.envs.disturbances import Disturbances, Ranges
from rimless_gym.envs.layout import MEMORY, PRICES, columns
from rimless_gym.envs.machines import NUMBERS, draw_machines, numbers_of, set_terms
from rimless_gym.envs.orders import AT, NO_LIMIT, give_results, orders_for, step_rows
from rimless_gym.envs.perturbation import disturb_rows, observe_noisily
from rimless_gym.envs.snapshots import ARRAYS
from rimless_gym.envs.start_shares import USUAL_STARTS, Starts
from rimless_gym.envs.starts import NO_START, start_rows
from rimless_gym.envs.task import Task
from rimless_gym.hybrid import Failure
from rimless_gym.kernel.stepping import STATE_SIZE, machine_arrays, scratch
from rimless_gym.params import WheelParams

#: Fewest rows for a thread; waking it for fewer does not pay.
LEAST_ROWS = 256


class Fleet:
    """N rows, one wheel each.

    Args:
        params: the machine of each row.
        task: what is paid for, in all rows at first.
        ranges: the parameters of each machine that are drawn when an episode begins.
        disturbances: what disturbs every episode.
        control: how long an action is held, and what it commands.
        starts: how often each kind of start is drawn.
        num_threads: threads that share a step.
        limit: greatest number of intervals in an episode.

    Attributes:
        params: the machine of each row before parameters are drawn, a list of N.
        tasks: what is paid for in each row, a list of N.
        memory: what is remembered of each row; see `rimless_gym.envs.layout`.
        numbers: current values of the parameters that are numbers, (len(NUMBERS), N).
        ended: whether a row's episode is over, or none has begun; bool (N,).
    """

    def __init__(
        self,
        params: Sequence[WheelParams],
        task: Task,
        ranges: Ranges,
        disturbances: Disturbances,
        control: Control = USUAL,
        starts: Starts = USUAL_STARTS,
        num_threads: int = 1,
        limit: int = NO_LIMIT,
    ) -> None:
        n = len(params)
        self.control, self.num_threads, self.limit = control, num_threads, limit
        self.memory = np.zeros((len(MEMORY), columns(n)))
        self.streams = np.zeros(n, dtype=np.uint64)
        self.ended = np.ones(n, dtype=np.bool_)
        self._works = [scratch() for _ in range(num_threads)]
        self._pool: ThreadPoolExecutor | None = None
        self._pool_of = 0  # the process that made it
        self._orders: list[NDArray[np.int64]] | None = None
        self.numbers, self.constants, self.poles = np.zeros((3, 1, 1))
        self.set_machines(params, ranges, np.arange(n))
        self.set_tasks([task] * n, np.arange(n))
        self.set_disturbances(disturbances)
        self.starts = starts

    def __len__(self) -> int:
        return len(self.streams)

    @property
    def begun(self) -> bool:
        """Whether any row has begun an episode."""
        return bool(self.memory[MEMORY.phi].any())  # phi is never 0 on the ground

    @property
    def states(self) -> NDArray[np.float64]:
        """A copy of the hybrid states, (N, STATE_SIZE)."""
        return self.memory[:STATE_SIZE, : len(self)].T.copy()

    def set_machines(
        self, params: Sequence[WheelParams], ranges: Ranges, rows: NDArray[np.int64]
    ) -> None:
        """Give each row its machine.

        `rows` are about to begin an episode; the others keep the parameters that they drew.
        """
        kept = np.setdiff1d(np.arange(len(self)), rows)
        before = [a + np.zeros(len(self)) for a in (self.numbers, self.constants, self.poles)]
        different = {machine: k for k, machine in enumerate(dict.fromkeys(params))}
        which = [different[machine] for machine in params]
        numbers = [numbers_of(machine) for machine in different]
        self.constants, self.poles = machine_arrays(list(different))
        self.numbers = np.array(numbers, dtype=np.float64).T[:, which].copy()
        if len(different) > 1 or ranges.bounds:  # else one column serves all rows
            self.constants, self.poles = self.constants[:, which].copy(), self.poles[which]
            now = self.numbers, self.constants, self.poles
            for array, values in zip(now, before, strict=True):
                array[..., kept] = values[..., kept]
        self.params, self.ranges = list(params), ranges
        self._ranged = np.array([NUMBERS.index(name) for name in ranges.bounds], dtype=np.int64)
        self._bounds = np.array(list(ranges.bounds.values()), dtype=np.float64).reshape(-1, 2)
        set_terms(self.numbers, self.memory)
        self._orders = None

    def set_tasks(self, tasks: Sequence[Task], rows: NDArray[np.int64]) -> None:
        """Set what is paid for in each row; only that of `rows` changes. Commands stay."""
        self.require_payable(tasks)
        prices = {task: dataclasses.astuple(task) for task in dict.fromkeys(tasks)}
        commands = self.memory[MEMORY.target_speed, rows]
        self.memory[PRICES, rows] = np.transpose([prices[tasks[i]] for i in rows])
        if self.control.speeds is not None:
            self.memory[MEMORY.target_speed, rows] = commands
        self.tasks = list(tasks)

    def require_payable(self, tasks: Sequence[Task]) -> None:
        """Refuse tasks with a target speed where speeds are commanded.

        Raises:
            ValueError: there is one.
        """
        targets = [task.target_speed for task in tasks if task.target_speed != math.inf]
        if targets and self.control.speeds is not None:
            raise ValueError(
                f"target_speed = {targets[0]:g}: the command takes its place; leave it out, and "
                "choose commands by `speeds`, or by the reset option 'speed'"
            )

    def set_disturbances(self, disturbances: Disturbances) -> None:
        """Set the disturbances of all rows; every row must then begin a new episode."""
        self.disturbances = disturbances
        self._settings = disturbances.settings(self.control.period)
        self._rough = disturbances != Disturbances()
        self.held = np.zeros((disturbances.delays[1] + 1, len(self)))

    def machine(self, i: int) -> WheelParams:
        """Row i's current machine, including the parameters drawn."""
        if not self.ranges.bounds:
            return self.params[i]
        drawn = {name: self.numbers[NUMBERS.index(name), i] for name in self.ranges.bounds}
        return self.params[i].replace(**drawn)

    def begin(
        self,
        rows: NDArray[np.int64],
        keys: NDArray[np.uint64],
        kind: int,
        given: NDArray[np.float64],
        observations: NDArray[np.float32],
        speeds: NDArray[np.float64] | None = None,
    ) -> None:
        """Begin the episodes of `rows`; their first observations go into `observations`, flat.

        `speeds` (K,) are commanded (m/s), in place of drawn ones.

        Raises:
            RuntimeError: a row found no start.
        """
        self.ended[rows] = True
        self.streams[rows] = keys
        if self.ranges.bounds:
            self._draw_machines(rows)
        commands = np.empty((0, 2))
        if self.control.speeds is not None:
            commands = np.empty((len(rows), 2))
            commands[:] = self.control.speeds if speeds is None else speeds[:, None]
        failed = start_rows(
            *(observations, rows, kind, given, self.starts.bounds, commands),
            *(self.memory, self.streams, self.held, self.constants, self._settings),
        )
        if failed >= 0:
            raise RuntimeError(f"row {failed}: {NO_START}")
        self.ended[rows] = False

    def _draw_machines(self, rows: NDArray[np.int64]) -> None:
        failed = draw_machines(
            *(rows, self._ranged, self._bounds, self.numbers),
            *(self.constants, self.poles, self.memory, self.streams),
        )
        if failed >= 0:
            names = self.ranges.bounds
            drawn = {name: float(self.numbers[NUMBERS.index(name), failed]) for name in names}
            raise RuntimeError(
                f"row {failed}: a machine with {drawn} cannot be stepped (its mass matrix is "
                "singular, or its motor too stiff): narrow the ranges"
            )

    def stepper(
        self, block: NDArray[np.float64], observations: NDArray[np.float32]
    ) -> Callable[[], int]:
        """A function that holds the actions in `memory` for one interval.

        It overwrites `block` (len(BLOCK), columns) and `observations` (flat), and returns what
        `step_rows` returns. Get a new one after any change of the fleet.
        """
        if self._orders is None:
            self._orders = self._divided()
        steps = [self._part(orders, block, observations) for orders in self._orders]
        return steps[0] if len(steps) == 1 else functools.partial(self._together, steps)

    def _divided(self) -> list[NDArray[np.int64]]:
        """Orders for each thread that is worth waking."""
        n = len(self)
        parts = max(1, min(self.num_threads, n // LEAST_ROWS))
        cuts = [n * k // parts for k in range(parts + 1)]
        arrays = self.memory, self.constants, self.poles
        return [
            orders_for(*(*arrays, self._works[k], self.limit, self.control, (cuts[k], cuts[k + 1])))
            for k in range(parts)
        ]

    def _part(
        self,
        orders: NDArray[np.int64],
        block: NDArray[np.float64],
        observations: NDArray[np.float32],
    ) -> Callable[[], int]:
        give_results(orders, block, observations)
        step = functools.partial(step_rows, orders.ctypes.data)
        arrays = block, observations, self.memory, self.constants, self.poles
        step.alive = orders, arrays, self._works  # type: ignore[attr-defined]
        if not self._rough:
            return step
        rows = int(orders[AT.begin]), int(orders[AT.end])
        return functools.partial(self._disturbed, step, observations, *rows)

    def _disturbed(
        self, step: Callable[[], int], observations: NDArray[np.float32], first: int, last: int
    ) -> int:
        memory, streams, settings = self.memory, self.streams, self._settings
        disturb_rows(memory, self.constants, streams, self.held, settings, first, last)
        unusual = step()
        if settings.noisy:
            width = self.control.width
            observe_noisily(observations, width, memory, streams, settings.noise, first, last)
        return unusual

    def _together(self, steps: Sequence[Callable[[], int]]) -> int:
        if self._pool is None or self._pool_of != os.getpid():  # a forked child has no threads
            self._pool, self._pool_of = ThreadPoolExecutor(self.num_threads), os.getpid()
        return sum(self._pool.map(lambda step: step(), steps))

    def range_left(self, i: int, code: int) -> RuntimeError:
        """The error for a motion of row i that left the model's range."""
        return RuntimeError(
            f"row {i}: the motion left the model's range ({Failure(code).name.lower()}) at t = "
            f"{self.memory[MEMORY.time, i]:.2f} s, state {self.memory[:STATE_SIZE, i]}: check the "
            f"parameters, {self.machine(i)}"
        )

    def get_state(self) -> dict[str, Any]:
        """Copies of everything that the future depends on, except the generators."""
        return {name: getattr(self, name).copy() for name in ARRAYS} | {
            "params": self.params.copy(),
            "ranges": self.ranges,
            "disturbances": self.disturbances,
            "tasks": self.tasks.copy(),
            "starts": self.starts,
            "control": self.control,
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned, of this fleet or another with as many rows.

        `rimless_gym.envs.snapshots` checks the state; nothing is checked here.
        """
        if (state["params"], state["ranges"]) != (self.params, self.ranges):
            self.set_machines(state["params"], state["ranges"], np.arange(len(self)))
        self.tasks, self.starts = state["tasks"].copy(), state["starts"]
        if state["disturbances"] != self.disturbances:
            self.set_disturbances(state["disturbances"])
        for name in ARRAYS:
            mine, theirs = getattr(self, name), state[name]
            if mine.shape == theirs.shape:
                mine[...] = theirs  # in place: the orders hold the array's address
            else:
                setattr(self, name, theirs.copy())
                self._orders = None

    def close(self) -> None:
        """Shut down the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_pool": None, "_orders": None}
