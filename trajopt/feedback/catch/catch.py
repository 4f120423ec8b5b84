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
import hashlib
from collections import OrderedDict
from collections.abc import Hashable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.checks import integer, positive, require_kind
from rimless_gym.equations import SINGLE
from rimless_gym.jit import cached
from rimless_gym.kernel.stepping import MODE, hybrid_states
from rimless_gym.params import WheelParams
from rimless_gym.presets import machine_name
from trajopt.feedback.catch.catch_file import read_times, write_times
from trajopt.feedback.catch.grid import StateGrid, Values, value
from trajopt.feedback.catch.options import Options, played
from trajopt.feedback.catch.value import NEVER, time_to_gait
from trajopt.feedback.law import Floats, Law, states_and_modes
from trajopt.feedback.orbit import squared_distances

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


@dataclasses.dataclass(frozen=True, repr=False)
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
    def to(cls, law: Law, near: float, counts: Sequence[int] | None = None) -> Catch:
        """The catch that leads to a law's gait; it takes some seconds to a minute of computing.

        Args:
            law: that takes over near its gait.
            near: distance from the gait at which it does; > 0.
            counts: of the grid's nodes, four of at least 2, default `COUNTS`.

        Raises:
            TypeError: an argument is of the wrong type.
            ValueError: a number is out of range, or none of the grid's nodes is near the gait.
            RuntimeError: the times do not converge.
        """
        require_kind("law", law, Law)
        near, counts = positive("near", near), _four(COUNTS if counts is None else counts)
        params, orbit = law.params, law.data.orbit
        grid, options = _grid(law, counts), Options.of(params)
        there = squared_distances(np.ascontiguousarray(grid.single()[:, :4]), orbit) < near**2
        if not there.any():
            raise ValueError(
                f"near = {near:g}, counts = {counts}: no node of the grid lies so near the gait, "
                "and nothing could lead there; raise the counts or near"
            )
        return cls(params, options, grid, time_to_gait(params, grid, options, there))

    def __repr__(self) -> str:
        nodes = " x ".join(map(str, self.grid.counts))
        return f"Catch({machine_name(self.params)}, {nodes} nodes)"

    def __call__(self, x: ArrayLike, mode: ArrayLike = SINGLE) -> Floats:
        """Voltages for states; arguments, result and errors are those of a `Law`."""
        smooth, modes = states_and_modes(x, mode)
        states, m = hybrid_states(smooth, modes), len(self.options.voltages)
        volts = np.tile(self.options.voltages, len(states))
        after = played(self.params, self.options, np.repeat(states, m, axis=0), volts)
        remaining = _remaining(after.states, after.cost, self.times, self.grid)
        longer = remaining.reshape(len(states), m)
        longer -= longer.min(axis=1, keepdims=True)
        weights = np.exp(-longer / SOFTNESS)
        mean = (weights * self.options.voltages).sum(axis=1) / weights.sum(axis=1)
        return np.asarray(mean if np.ndim(x) == 2 else mean[0])


def _four(counts: Sequence[int]) -> tuple[int, ...]:
    """Four numbers of nodes."""
    if len(counts) != len(COUNTS):
        raise ValueError(f"counts = {counts}: must be four, one for each coordinate")
    return tuple(integer("counts", count, least=2) for count in counts)


def _grid(law: Law, counts: Sequence[int]) -> StateGrid:
    """The grid for the catch that leads to a law's gait."""
    rates = REACH * np.abs(law.data.orbit.states[:, 2:]).max(axis=0)
    return StateGrid.over(law.params, rates, counts)


_KEPT: OrderedDict[Hashable, Catch] = OrderedDict()


def catch_for(law: Law, near: float, folder: Path | None = None) -> Catch:
    """The catch that leads to a law's gait; of the last `MOST_KEPT` gaits it is planned only once.

    Args:
        law: see `Catch.to`.
        near: see `Catch.to`.
        folder: where it is also kept in a file, and read from if it is there.

    Raises:
        TypeError, ValueError, RuntimeError: see `Catch.to`; or its file is damaged.
        OSError: the folder cannot be written.
    """
    require_kind("law", law, Law)
    key = law.params, near, COUNTS, law.data.orbit.states.tobytes()
    if key not in _KEPT:
        _KEPT[key] = Catch.to(law, near) if folder is None else _filed(law, near, key, folder)
    _KEPT.move_to_end(key)
    while len(_KEPT) > MOST_KEPT:
        _KEPT.popitem(last=False)
    return _KEPT[key]


def _filed(law: Law, near: float, key: Hashable, folder: Path) -> Catch:
    """The catch from its file, or planned and written to it."""
    path = folder / f"catch_{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.npz"
    if path.exists():
        options, grid = Options.of(law.params), _grid(law, COUNTS)
        return Catch(law.params, options, grid, read_times(path, COUNTS))
    catch = Catch.to(law, near)
    folder.mkdir(parents=True, exist_ok=True)
    write_times(path, catch.times)
    return catch


@cached()
def _remaining(states, cost, values, grid):  # type: ignore[no-untyped-def]
    total = np.empty(len(cost))
    for i in range(len(cost)):
        x = states[i]
        ahead = value(values, grid, x[0], x[1], x[2], x[3], x[MODE])
        total[i] = min(cost[i] + min(ahead, NEVER), FALL)
    return total
