"""Many wheels and their episodes: what both environments are built on.

The single environment is a batch of one. Every row is computed by the same compiled functions,
with the same results, however many rows there are.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import itertools
import math
import os
import reprlib
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rimless_gym.envs.arguments import (
    DRAWN_START,
    USUAL,
    Control,
    EpisodeStart,
    as_starts,
)
from rimless_gym.envs.disturbances import (
    Disturbances,
    Ranges,
    as_disturbances,
    as_ranges,
    disturb_rows,
    observe_noisily,
)
from rimless_gym.envs.interval import ARGUMENT, NO_LIMIT, Arguments, compiled_step
from rimless_gym.envs.layout import MEMORY, WEIGHTS, columns
from rimless_gym.envs.starts import (
    NO_START,
    NUMBERS,
    Starts,
    draw_params,
    numbers_of,
    set_task_constants,
    start_rows,
)
from rimless_gym.envs.task import Task
from rimless_gym.kernel.stepping import STATE_SIZE, kernel_address, machine_arrays, scratch
from rimless_gym.params import N_CONSTANTS, WheelParams
from rimless_gym.streams import Ground

if TYPE_CHECKING:
    from rimless_gym.rendering.canvas import Frame

#: Fewest rows for a thread; waking it for fewer does not pay off.
LEAST_ROWS = 256

#: The arrays that a snapshot copies; its other parts, `_SETTINGS`, are immutable.
ARRAYS = ("memory", "streams", "held", "constants", "poles", "numbers", "ended")

_SETTINGS = ("params", "ranges", "disturbances", "tasks", "starts", "control")


class Batch:
    """N rows, one wheel each, made from the environments' arguments.

    `limit` is the greatest number of intervals in an episode.

    Attributes:
        params: the machine of each row before parameters are drawn, a list of N.
        tasks: the task of each row, a list of N.
        memory: what is remembered of each row; see `rimless_gym.envs.layout`.
        numbers: current values of the parameters that are numbers, (len(NUMBERS), N).
        ended: whether a row's episode is over, or none has begun; bool (N,).
    """

    def __init__(
        self,
        params: Sequence[WheelParams],
        task: Task,
        ranges: Ranges | Mapping[str, Any] | None = None,
        disturbances: Disturbances | Mapping[str, Any] | None = None,
        control: Control = USUAL,
        starts: Starts | Mapping[str, Any] | None = None,
        num_threads: int = 1,
        limit: int = NO_LIMIT,
    ) -> None:
        n, ranges = len(params), as_ranges(ranges)
        ranges.require_valid(params)
        self.control, self.num_threads, self.limit = control, num_threads, limit
        self.memory = np.zeros((len(MEMORY), columns(n)))
        self.streams = np.zeros(n, dtype=np.uint64)
        self.ended = np.ones(n, dtype=np.bool_)
        self._works = [scratch() for _ in range(num_threads)]
        self._pool: ThreadPoolExecutor | None = None
        self._pool_process = 0  # the process that made it
        self._arguments: list[NDArray[np.int64]] | None = None
        self.numbers, self.constants, self.poles = np.zeros((3, 1, 1))
        self.set_params(params, ranges, np.arange(n))
        self.set_tasks([task] * n, np.arange(n))
        self.set_disturbances(as_disturbances(disturbances))
        self.starts = as_starts(starts)

    def __len__(self) -> int:
        return len(self.streams)

    @property
    def begun(self) -> bool:
        """Whether any row has begun an episode."""
        return bool(self.memory[MEMORY.phi].any())  # phi is never 0 on the ground

    def require_begun(self) -> None:
        """Refuse to go on before the first reset."""
        if not self.begun:
            raise RuntimeError("no episode has begun: call reset() first")

    @property
    def states(self) -> NDArray[np.float64]:
        """A copy of the hybrid states, (N, STATE_SIZE)."""
        return self.memory[:STATE_SIZE, : len(self)].T.copy()

    @property
    def commands(self) -> NDArray[np.float64]:
        """The commanded speed of each row (m/s), (N,); 0 before the first episode."""
        speeds = self.memory[MEMORY.target_speed, : len(self)]
        return speeds.copy() if self.begun else np.zeros(len(self))

    def set_params(
        self, params: Sequence[WheelParams], ranges: Ranges, rows: NDArray[np.int64]
    ) -> None:
        """Give each row its machine.

        `rows` are about to begin an episode; the others keep the parameters that they drew.
        """
        others = np.setdiff1d(np.arange(len(self)), rows)
        before = [a + np.zeros(len(self)) for a in (self.numbers, self.constants, self.poles)]
        different = {one: k for k, one in enumerate(dict.fromkeys(params))}
        which = [different[one] for one in params]
        numbers = [numbers_of(one) for one in different]
        self.constants, self.poles = machine_arrays(list(different))
        self.numbers = np.array(numbers, dtype=np.float64).T[:, which].copy()
        if len(different) > 1 or ranges.bounds:  # else one column serves all rows
            self.constants, self.poles = self.constants[:, which].copy(), self.poles[which]
            now = self.numbers, self.constants, self.poles
            for array, values in zip(now, before, strict=True):
                array[..., others] = values[..., others]
        self.params, self.ranges = list(params), ranges
        self._ranged = np.array([NUMBERS.index(name) for name in ranges.bounds], dtype=np.int64)
        self._bounds = np.array(list(ranges.bounds.values()), dtype=np.float64).reshape(-1, 2)
        set_task_constants(self.numbers, self.memory)
        self._arguments = None

    def set_tasks(self, tasks: Sequence[Task], rows: NDArray[np.int64]) -> None:
        """Set the task of each row; only that of `rows` changes. Commanded speeds stay."""
        self.require_no_target(tasks)
        weights = {task: dataclasses.astuple(task) for task in dict.fromkeys(tasks)}
        commands = self.memory[MEMORY.target_speed, rows]
        self.memory[WEIGHTS, rows] = np.transpose([weights[tasks[i]] for i in rows])
        if self.control.speeds is not None:
            self.memory[MEMORY.target_speed, rows] = commands
        self.tasks = list(tasks)

    def require_no_target(self, tasks: Sequence[Task]) -> None:
        """Refuse tasks with a target speed where speeds are commanded."""
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
        self._disturbed = disturbances != Disturbances()
        self.held = np.zeros((disturbances.delays[1] + 1, len(self)))

    def params_of(self, i: int) -> WheelParams:
        """Row i's current machine, including the parameters drawn."""
        if not self.ranges.bounds:
            return self.params[i]
        drawn: dict[str, Any] = {
            name: self.numbers[NUMBERS.index(name), i] for name in self.ranges.bounds
        }
        return dataclasses.replace(self.params[i], **drawn)

    def change(
        self,
        rows: NDArray[np.int64],
        params: Sequence[WheelParams] | None = None,
        ranges: Ranges | None = None,
        tasks: Sequence[Task] | None = None,
        starts: Starts | None = None,
        disturbances: Disturbances | None = None,
    ) -> None:
        """Set what is given, for the episodes that `rows` are about to begin."""
        self.starts = starts or self.starts
        if tasks is not None:
            self.set_tasks(tasks, rows)
        if params is not None:
            self.set_params(params, ranges or self.ranges, rows)
        if disturbances is not None:
            self.set_disturbances(disturbances)

    def begin(
        self,
        rows: NDArray[np.int64],
        keys: NDArray[np.uint64],
        observations: NDArray[np.float32],
        start: EpisodeStart = DRAWN_START,
    ) -> None:
        """Begin the episodes of `rows`; their first observations go into `observations`, flat."""
        self.ended[rows] = True
        self.streams[rows] = keys
        if self.ranges.bounds:
            self._draw_params(rows)
        commands = np.empty((0, 2))
        if self.control.speeds is not None:
            commands = np.empty((len(rows), 2))
            chosen = start.speeds
            commands[:] = self.control.speeds if chosen is None else chosen[:, None]
        failed = start_rows(
            *(observations, rows, start.kind, start.states, self.starts.bounds, commands),
            *(self.memory, self.streams, self.held, self.constants, self._settings),
        )
        if failed >= 0:
            raise RuntimeError(f"row {failed}: {NO_START}")
        self.ended[rows] = False

    def _draw_params(self, rows: NDArray[np.int64]) -> None:
        failed = draw_params(
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
        self, results: NDArray[np.float64], observations: NDArray[np.float32]
    ) -> Callable[[], int]:
        """A function that holds the actions in `memory` for one interval.

        It overwrites `results` (len(RESULT), columns) and `observations` (flat), and returns what
        `step_rows` returns. Get a new one after any change of the batch.
        """
        if self._arguments is None:
            self._arguments = self._divide()
        steps = []
        for arguments in self._arguments:
            arguments[ARGUMENT.results] = results.ctypes.data
            arguments[ARGUMENT.observations] = observations.ctypes.data
            step: Any = functools.partial(compiled_step(), arguments.ctypes.data)
            step.alive = arguments, results, observations, self.memory, self.constants, self.poles
            if self._disturbed:
                rows = int(arguments[ARGUMENT.begin]), int(arguments[ARGUMENT.end])
                step = functools.partial(self._step_disturbed, step, observations, *rows)
            steps.append(step)
        return steps[0] if len(steps) == 1 else functools.partial(self._together, steps)

    def _divide(self) -> list[NDArray[np.int64]]:
        """Arguments of `step_rows` for each thread that is worth waking."""
        n, control = len(self), self.control
        parts = max(1, min(self.num_threads, n // LEAST_ROWS))
        cuts = [n * k // parts for k in range(parts + 1)]
        arrays = [array.ctypes.data for array in (self.memory, self.constants, self.poles)]
        sizes = self.memory.shape[1], self.constants.shape[1]
        common = *sizes, self.limit, control.ticks, control.by_current, control.width
        kernel = kernel_address()
        return [
            np.array(
                Arguments(0, 0, *arrays, work.ctypes.data, kernel, *common, *rows), dtype=np.int64
            )
            for work, rows in zip(self._works, itertools.pairwise(cuts), strict=False)
        ]

    def _step_disturbed(
        self, step: Callable[[], int], observations: NDArray[np.float32], first: int, last: int
    ) -> int:
        memory, streams, settings = self.memory, self.streams, self._settings
        disturb_rows(memory, self.constants, streams, self.held, settings, first, last)
        unusual = step()
        if any(settings.noise):
            width = self.control.width
            observe_noisily(observations, width, memory, streams, settings.noise, first, last)
        return unusual

    def _together(self, steps: Sequence[Callable[[], int]]) -> int:
        if self._pool is None or self._pool_process != os.getpid():  # a fork has no threads
            self._pool, self._pool_process = ThreadPoolExecutor(self.num_threads), os.getpid()
        return sum(self._pool.map(lambda step: step(), steps))

    def frame(self, i: int) -> Frame:
        """The picture of row i."""
        from rimless_gym.rendering.wheel import Scene, draw, with_ground  # pygame only when needed

        self.require_begun()
        params, memory = self.params_of(i), self.memory[:, i]
        scene = Scene(
            phi=memory[MEMORY.phi],
            theta=memory[MEMORY.theta],
            mode=int(memory[MEMORY.mode]),
            foot_x=memory[MEMORY.foot] * params.step_length,
            voltage=memory[MEMORY.voltage],
            time=memory[MEMORY.time],
        )
        ground = Ground(memory[MEMORY.ground_seed], memory[MEMORY.slope_std])
        if ground.slope_std > 0.0:
            scene = with_ground(scene, params, ground, int(memory[MEMORY.foot]))
        return draw(params, scene)

    def get_state(self) -> dict[str, Any]:
        """Copies of everything that the future depends on, except the generators."""
        return {name: copy.copy(getattr(self, name)) for name in (*ARRAYS, *_SETTINGS)}

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore what `get_state` returned, of this batch or another with as many rows.

        `require_snapshot` checks the state; nothing is checked here.
        """
        if (state["params"], state["ranges"]) != (self.params, self.ranges):
            self.set_params(state["params"], state["ranges"], np.arange(len(self)))
        self.tasks, self.starts = state["tasks"].copy(), state["starts"]
        if state["disturbances"] != self.disturbances:
            self.set_disturbances(state["disturbances"])
        for name in ARRAYS:
            mine, theirs = getattr(self, name), state[name]
            if mine.shape == theirs.shape:
                mine[...] = theirs  # in place: the arguments hold the array's address
            else:
                setattr(self, name, theirs.copy())
                self._arguments = None

    def close(self) -> None:
        """Shut down the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_pool": None, "_arguments": None}


def require_snapshot(
    state: Any, parts: Collection[str], n: int, control: Control, owner: str
) -> None:
    """Refuse a state that `get_state` of an `owner` with these settings cannot have returned.

    What compiled code reads is checked in full: shapes, types, and that numbers are finite.
    """
    remedy = f"give what get_state() of a {owner} returned"
    if not isinstance(state, dict) or state.keys() != set(parts):
        raise ValueError(f"state = {reprlib.repr(state)}: must have the parts {parts}; {remedy}")
    batch = state["batch"]
    if not isinstance(batch, dict) or batch.keys() != {*ARRAYS, *_SETTINGS}:
        raise ValueError(f"state['batch'] = {reprlib.repr(batch)}: {remedy}")
    if len(batch["params"]) != n or len(state["generators"]) != n:
        raise ValueError(f"the state is of {len(batch['params'])} rows, not of {n}; {remedy}")
    if batch["control"] != control:
        raise ValueError(f"the state is of {batch['control']}, not of {control}")
    each = bool(batch["ranges"].bounds) or np.size(batch["poles"]) == n
    machines, numbers = n if each else 1, np.float64
    expected: dict[str, tuple[tuple[int, ...], type]] = {
        "memory": ((len(MEMORY), columns(n)), numbers),
        "streams": ((n,), np.uint64),
        "held": ((batch["disturbances"].delays[1] + 1, n), numbers),
        "constants": ((N_CONSTANTS, machines), numbers),
        "poles": ((machines,), numbers),
        "numbers": ((len(NUMBERS), n), numbers),
        "ended": ((n,), np.bool_),
        "seen": ((n, control.width), np.float32),  # of a vector environment only
    }
    for name, array in (batch | state).items():
        if name not in expected:
            continue
        shape, dtype = expected[name]
        if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != dtype:
            raise ValueError(f"state: {name} must be an array {shape} of {dtype}; {remedy}")
        finite = np.isfinite(array)
        if name == "memory":  # where there is no target, it is infinite
            finite[MEMORY.target_speed] |= array[MEMORY.target_speed] == np.inf
        if not finite.all():
            raise ValueError(f"state: {name} must be finite; {remedy}")


def restore(generators: Sequence[np.random.Generator], states: Sequence[dict[str, Any]]) -> None:
    """Put each generator into its state, all or none."""
    before = [dict(one.bit_generator.state) for one in generators]
    try:
        for one, state in zip(generators, states, strict=True):
            one.bit_generator.state = state
    except Exception as error:
        for one, state in zip(generators, before, strict=True):
            one.bit_generator.state = state
        kind = type(generators[0].bit_generator).__name__
        raise ValueError(f"state: generators: {error}: must be states of NumPy's {kind}") from error
