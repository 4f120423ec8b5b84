"""The catch: a plan by dynamic programming, and one look ahead on the simulator itself.

`time_to_gait` knows roughly how long it takes from every state to the gait. The catch plays each of
a few voltages forward on the stepping kernel, exactly, and asks after which of them the least time
remains (a rollout of one stage: Bertsekas, Dynamic Programming and Optimal Control, 6.4). It pumps
the pendulum up, swings it over without losing the foot, and needs nothing but the state.

Its voltage is a mean of all of them, in which a voltage that takes longer counts exponentially
less. The best one alone would jump from state to state, which no network can imitate.
"""

from __future__ import annotations

import dataclasses
from collections import OrderedDict
from collections.abc import Hashable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rimless_gym.kernel.stepping import MODE, hybrid_states
from rimless_gym.params import WheelParams
from trajopt.feedback.catch.grid import StateGrid, Values, value
from trajopt.feedback.catch.options import Options, played
from trajopt.feedback.catch.value import NEVER, time_to_gait
from trajopt.feedback.law import Floats
from trajopt.feedback.orbit import Orbit, squared_distances

#: Nodes of the leg's angle, the pendulum's angle, the leg's rate and the pendulum's rate.
COUNTS = (13, 36, 25, 61)

#: Time (s) by which a voltage takes longer than the best if it counts 1/e of it.
SOFTNESS = 0.01

#: Catches that are kept in memory (6 MB each).
MOST_KEPT = 8

#: The time (s) of a voltage that leads to a fall: longer than any other, and finite, so that times
#: can be compared where all of them do.
FALL = 2 * NEVER

#: The grid's rates reach so much further than the gait's own.
REACH = 1.3


@dataclasses.dataclass(frozen=True)
class Catch:
    """The voltage after which about the least time to a gait remains.

    Attributes:
        params: the machine.
        options: voltages to choose from.
        grid: of the times.
        times: to the gait (s).
    """

    params: WheelParams
    options: Options
    grid: StateGrid
    times: Values

    @classmethod
    def to(
        cls, params: WheelParams, orbit: Orbit, near: float, counts: tuple[int, ...] | None = None
    ) -> Catch:
        """The catch that leads to a gait; it takes some seconds to a minute of computing.

        Args:
            params: the machine.
            orbit: the gait's.
            near: distance from the orbit at which a law takes over.
            counts: of the grid's nodes, default `COUNTS`.

        Raises:
            ValueError: none of the grid's nodes is near the gait.
            RuntimeError: the times do not converge.
        """
        rates, counts = REACH * np.abs(orbit.states[:, 2:]).max(axis=0), counts or COUNTS
        grid, options = StateGrid.over(params, rates, counts), Options.of(params)
        there = squared_distances(np.ascontiguousarray(grid.single()[:, :4]), orbit) < near**2
        if not there.any():
            raise ValueError(
                f"near = {near:g}, counts = {counts}: no node of the grid lies so near the gait, "
                "and nothing could lead there; raise the counts or near"
            )
        return cls(params, options, grid, time_to_gait(params, grid, options, there))

    def __call__(self, x: Floats, mode: NDArray[np.int64]) -> Floats:
        """Voltages (N,) for states (N, 4) and stance modes (N,)."""
        states, m = hybrid_states(x, mode), len(self.options.voltages)
        volts = np.tile(self.options.voltages, len(x))
        after = played(self.params, self.options, np.repeat(states, m, axis=0), volts)
        remaining = _remaining(after.states, after.cost, self.times, self.grid)
        longer = remaining.reshape(len(x), m)
        longer -= longer.min(axis=1, keepdims=True)
        weights = np.exp(-longer / SOFTNESS)
        mean = (weights * self.options.voltages).sum(axis=1) / weights.sum(axis=1)
        return np.asarray(mean)


_KEPT: OrderedDict[Hashable, Catch] = OrderedDict()


def catch_for(params: WheelParams, orbit: Orbit, near: float) -> Catch:
    """The catch that leads to a gait; of the last `MOST_KEPT` gaits it is planned only once.

    Raises:
        ValueError, RuntimeError: see `Catch.to`.
    """
    key = params, near, COUNTS, orbit.states.tobytes()
    if key not in _KEPT:
        _KEPT[key] = Catch.to(params, orbit, near)
    _KEPT.move_to_end(key)
    while len(_KEPT) > MOST_KEPT:
        _KEPT.popitem(last=False)
    return _KEPT[key]


@njit(error_model="numpy")
def _remaining(states, cost, values, grid):  # type: ignore[no-untyped-def]
    total = np.empty(len(cost))
    for i in range(len(cost)):
        x = states[i]
        ahead = value(values, grid, x[0], x[1], x[2], x[3], x[MODE])
        total[i] = min(cost[i] + min(ahead, NEVER), FALL)
    return total
