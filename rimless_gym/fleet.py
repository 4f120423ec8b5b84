"""Many wheels and the episodes they are in: what both environments are made of.

The single environment is a fleet of one. Whatever happens to a row is computed by the same
compiled functions, with the same results, however many rows there are.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rimless_gym.hybrid import FAILURES
from rimless_gym.interval import (
    END_CHARGE,
    FRICTION,
    IDLE_POWER,
    LEG_SCALE,
    MEMORY_SIZE,
    SLOPE,
    TIME,
    VALUE_OF_DISTANCE,
    VOLTAGE_LIMIT,
    WEIGHT,
    step_rows,
)
from rimless_gym.params import WheelParams
from rimless_gym.starts import observe_rows, start_rows
from rimless_gym.stepping import STATE_SIZE, require_steppable, scratch
from rimless_gym.task import NO_START, OBSERVATION_SIZE, Task

#: Rows that a thread takes at least; fewer are not worth waking it.
LEAST_ROWS = 256


class Fleet:
    """N rows.

    Args:
        params: the machine of each row.
        task: what is paid for.
        num_threads: that share a step.

    Attributes:
        params: the machine of each row, a list of N.
        memory: what is remembered of each row, `rimless_gym.interval`.
        ended: whether a row's episode is over, or none has begun; bool (N,).
    """

    def __init__(self, params: Sequence[WheelParams], task: Task, num_threads: int = 1) -> None:
        n = len(params)
        self.task = task
        self.memory = np.zeros((MEMORY_SIZE, n))
        self.streams = np.zeros(n, dtype=np.uint64)
        self.ended = np.ones(n, dtype=np.bool_)
        self.num_threads = num_threads
        self.params: list[WheelParams] = []
        self._pool: ThreadPoolExecutor | None = None
        self._works = [scratch() for _ in range(num_threads)]
        self.set_params(params)

    def __len__(self) -> int:
        return self.memory.shape[1]

    @property
    def states(self) -> NDArray[np.float64]:
        """A copy of the hybrid states, (N, STATE_SIZE)."""
        return self.memory[:STATE_SIZE].T.copy()

    def set_params(self, params: Sequence[WheelParams]) -> None:
        """Give each row its machine; rows whose machine changes should begin a new episode."""
        different = {each: k for k, each in enumerate(dict.fromkeys(params))}
        for each in different:
            require_steppable(each)
        self.params = list(params)
        which = [different[each] for each in params]
        rows = [_machine_rows(each, self.task) for each in different]
        for name in rows[0]:
            self.memory[name] = np.array([values[name] for values in rows])[which]
        shared = len(different) == 1
        machines = list(different) if shared else params
        self.constants = np.stack([each.constants_array for each in machines], axis=1)
        self.poles = np.array([each.motor_pole for each in machines])

    def begin(
        self,
        rows: NDArray[np.int64],
        keys: NDArray[np.uint64],
        kind: int,
        given: NDArray[np.float64],
        observations: NDArray[np.float32],
    ) -> None:
        """Begin the episodes of `rows`; their first observations go into `observations`, flat.

        Raises:
            RuntimeError: a row found no start.
        """
        self.ended[rows] = True
        failed = start_rows(
            observations, rows, keys, kind, given, self.memory, self.streams, self.constants
        )
        if failed >= 0:
            raise RuntimeError(f"row {failed}: {NO_START}")
        self.ended[rows] = False

    def observe(self) -> NDArray[np.float32]:
        """The observations of all rows, (N, OBSERVATION_SIZE)."""
        observations = np.empty((len(self), OBSERVATION_SIZE), dtype=np.float32)
        observe_rows(observations.reshape(-1), self.memory)
        return observations

    def step(self, block: NDArray[np.float64], observations: NDArray[np.float32]) -> int:
        """Hold the commands in `memory` for one interval; returns how many rows failed anyhow."""
        arguments = observations, block, self.memory, self.constants, self.poles
        n = len(self)
        parts = min(self.num_threads, n // LEAST_ROWS)
        if parts < 2:
            return step_rows(*arguments, self._works[0], 0, n)
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.num_threads)
        cuts = [n * k // parts for k in range(parts + 1)]
        jobs = [
            self._pool.submit(step_rows, *arguments, work, first, last)
            for work, first, last in zip(self._works[:parts], cuts[:-1], cuts[1:], strict=True)
        ]
        return sum(job.result() for job in jobs)

    def range_left(self, i: int, code: int) -> RuntimeError:
        """The error for a motion of row i that left the model's range."""
        return RuntimeError(
            f"row {i}: the motion left the model's range ({FAILURES[code]}) at t = "
            f"{self.memory[TIME, i]:.2f} s, state {self.memory[:STATE_SIZE, i]}: check the "
            f"parameters, {self.params[i]}"
        )

    def close(self) -> None:
        """Let the threads go."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_pool": None}


def _machine_rows(params: WheelParams, task: Task) -> dict[int, float]:
    _, _, end = task.reward_terms(params, 0.0, 0.0, 1.0)
    return {
        VOLTAGE_LIMIT: params.voltage_limit,
        IDLE_POWER: params.idle_power,
        FRICTION: params.friction,
        WEIGHT: params.weight,
        SLOPE: params.slope,
        LEG_SCALE: 2 / params.leg_angle,
        VALUE_OF_DISTANCE: task.value_of_distance,
        END_CHARGE: -end,
    }
