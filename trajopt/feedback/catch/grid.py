"""A function of the hybrid state, kept at the nodes of a grid and interpolated in between.

In single stance the grid spans all four coordinates. In double stance the leg's angle and rate are
known, so that a grid of the pendulum's angle and rate will do; it has the same spacings.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.jit import inner
from rimless_gym.kernel.stepping import hybrid_states
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats

#: Distance of the outermost nodes from the guards of touchdown (rad), which they must not cross.
INSIDE = 1e-6

#: Highest index of a cell, as a share of a cell less than the last node's.
_LAST = 1.0 - 1e-9


class StateGrid(NamedTuple):
    """Nodes of the four coordinates, evenly spaced; the pendulum's angle goes round.

    Attributes:
        low: of each coordinate's first node, shape (4,).
        spacing: shape (4,).
        counts: of nodes, shape (4,).
    """

    low: Floats
    spacing: Floats
    counts: np.ndarray

    @classmethod
    def over(cls, params: WheelParams, rates: Sequence[float], counts: Sequence[int]) -> StateGrid:
        """The grid of a machine.

        Args:
            params: the machine.
            rates: largest of the leg and of the pendulum (rad/s).
            counts: of nodes of each coordinate; at least 2.
        """
        c = params.constants
        low = np.array([c.a, -np.pi, -rates[0], -rates[1]])
        high = np.array([c.b, np.pi, *rates])
        spacing = (high - low) / (np.array(counts) - [1, 0, 1, 1])
        return cls(low, spacing, np.array(counts))

    def axis(self, coordinate: int) -> Floats:
        """A coordinate's nodes."""
        nodes = np.arange(self.counts[coordinate])
        return np.asarray(self.low[coordinate] + self.spacing[coordinate] * nodes)

    def single(self) -> Floats:
        """Hybrid states (N, STATE_SIZE) of the nodes in single stance."""
        axes = [self.axis(coordinate) for coordinate in range(4)]
        axes[0] = np.clip(axes[0], axes[0][0] + INSIDE, axes[0][-1] - INSIDE)
        return hybrid_states(np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 4), SINGLE)

    def double(self) -> Floats:
        """Hybrid states (N, STATE_SIZE) of the nodes in double stance."""
        axes = [self.low[:1], self.axis(1), np.zeros(1), self.axis(3)]
        return hybrid_states(np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 4), DOUBLE)


class Values(NamedTuple):
    """A function of the hybrid state.

    Attributes:
        single: values at the nodes in single stance, shape `counts`.
        double: the same in double stance, shape (counts[1], counts[3]).
    """

    single: Floats
    double: Floats


@inner
def value(values, grid, phi, theta, dphi, dtheta, mode):  # type: ignore[no-untyped-def]
    """The function at a hybrid state; beyond the grid it is as at its edge."""
    j, g = _cell_round(theta, grid, 1)
    m, i = _cell(dtheta, grid, 3)
    following = j + 1 if j + 1 < grid.counts[1] else 0
    if mode == DOUBLE:
        v = values.double
        return (1 - g) * _line(v[j], m, i) + g * _line(v[following], m, i)
    k, f = _cell(phi, grid, 0)
    n, h = _cell(dphi, grid, 2)
    total = 0.0
    for side in range(2):
        v, weight = values.single[k + side], f if side else 1 - f
        here = (1 - h) * _line(v[j, n], m, i) + h * _line(v[j, n + 1], m, i)
        there = (1 - h) * _line(v[following, n], m, i) + h * _line(v[following, n + 1], m, i)
        total += weight * ((1 - g) * here + g * there)
    return total


@inner
def _line(row, m, share):  # type: ignore[no-untyped-def]
    return (1 - share) * row[m] + share * row[m + 1]


@inner
def _cell(x, grid, c):  # type: ignore[no-untyped-def]
    """The node below a coordinate, and the share of the way to the next one."""
    place = (x - grid.low[c]) / grid.spacing[c]
    place = min(max(place, 0.0), grid.counts[c] - 2 + _LAST)
    return int(place), place - int(place)


@inner
def _cell_round(x, grid, c):  # type: ignore[no-untyped-def]
    """The same of an angle that goes round."""
    place = ((x - grid.low[c]) / grid.spacing[c]) % grid.counts[c]
    node = min(int(place), grid.counts[c] - 1)
    return node, place - node
