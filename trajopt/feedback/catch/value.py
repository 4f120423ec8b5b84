"""How long it takes to reach a gait from every state, by dynamic programming.

The time is that of the best sequence of the catch's options, with charges for a foot that is hardly
pressed down. It solves Bellman's equation on a grid, by sweeps in alternating order (Bertsekas,
Dynamic Programming and Optimal Control, 6.5; Munos and Moore, Machine Learning 49, 2002, for grids
in control).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rimless_gym.jit import cached
from rimless_gym.kernel.stepping import MODE
from rimless_gym.params import WheelParams
from trajopt.feedback.catch.grid import StateGrid, Values, value
from trajopt.feedback.catch.options import Options, played
from trajopt.feedback.law import Floats

#: The time (s) of a state from which nothing leads to the gait.
NEVER = 20.0

#: Most sweeps, and the largest change (s) at which they have converged.
SWEEPS, CONVERGED = 400, 1e-3


class Outcomes(NamedTuple):
    """What the options lead to from n nodes.

    Attributes:
        states: smooth states and modes, shape (n, options, 5).
        cost: shape (n, options); infinite for a fall.
    """

    states: NDArray[np.float32]
    cost: NDArray[np.float32]


def time_to_gait(
    params: WheelParams, grid: StateGrid, options: Options, there: NDArray[np.bool_]
) -> Values:
    """The time (s) to a gait from all states, `NEVER` where nothing leads there.

    Args:
        params: the machine.
        grid: its nodes.
        options: what can be done.
        there: which nodes in single stance are at the gait, in the order of `StateGrid.single`.

    Raises:
        RuntimeError: the times have not converged after `SWEEPS` sweeps.
    """
    single = outcomes(params, options, grid.single())
    double = outcomes(params, options, grid.double())
    counts = grid.counts
    times = np.where(there, 0.0, NEVER)
    values = Values(times.reshape(counts), np.full((counts[1], counts[3]), NEVER))
    open_single = np.flatnonzero(~there & np.isfinite(single.cost).any(axis=1))
    open_double = np.flatnonzero(np.isfinite(double.cost).any(axis=1))
    for sweep in range(SWEEPS):
        order = 1 if sweep % 2 == 0 else -1
        change = _swept(values.single.reshape(-1), open_single[::order], single, values, grid)
        change = max(
            change, _swept(values.double.reshape(-1), open_double[::order], double, values, grid)
        )
        if change < CONVERGED:
            return values
    raise RuntimeError(
        f"the times to the gait still change by {change:.3g} s after {SWEEPS} sweeps; wanted is "
        f"{CONVERGED:g} s: take a grid of other counts"
    )


def outcomes(params: WheelParams, options: Options, nodes: Floats) -> Outcomes:
    """Play every option from every node."""
    n, m = len(nodes), len(options.voltages)
    states, cost = np.empty((n, m, 5), np.float32), np.empty((n, m), np.float32)
    for k, volts in enumerate(options.voltages):
        after = played(params, options, nodes, np.full(n, volts))
        states[:, k, :4], states[:, k, 4] = after.states[:, :4], after.states[:, MODE]
        cost[:, k] = after.cost
    states[:, :, 1] = np.mod(states[:, :, 1], 2 * np.pi)
    return Outcomes(states, cost)


@cached()
def _swept(times, nodes, found, values, grid):  # type: ignore[no-untyped-def]
    """Improve the times at nodes, one after the other; the largest change."""
    largest = 0.0
    for i in nodes:
        least = NEVER
        for k in range(found.cost.shape[1]):
            if found.cost[i, k] < least:
                x = found.states[i, k]
                ahead = value(values, grid, x[0], x[1], x[2], x[3], x[4])
                least = min(least, found.cost[i, k] + ahead)
        largest = max(largest, times[i] - least)
        times[i] = least
    return largest
