"""The start-up controller: what brings the wheel to a gait from rest, and from anywhere else.

It minimises the return that an episode loses before the wheel is at the gait: haste costs energy,
delay costs travel. That cost from every state, by the best sequence of a few voltages each held for
a moment, follows from Bellman's equation on a grid, by sweeps in alternating order (Bertsekas,
Dynamic Programming and Optimal Control, 6.5; Munos and Moore, Machine Learning 49, 2002). The
controller simulates each of the voltages on the stepping kernel, exactly, and computes after which
of them the least cost remains (a rollout of one stage: Bertsekas, 6.4). Its voltage is a mean of
all of them, in which one that costs more counts exponentially less: the best one alone would jump
from state to state, which no network can imitate.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rimless_gym.checks import positive, require_kind
from rimless_gym.energy import ROW
from rimless_gym.envs.task import USUAL_TASK
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import cached, inner
from rimless_gym.kernel.stepping import MODE, advance, hybrid_states
from rimless_gym.params import WheelParams
from trajopt.feedback.controller import CONTACT_MARGIN, NEAR
from trajopt.feedback.law import Floats, states_and_modes
from trajopt.feedback.orbit import Orbit, squared_distances
from trajopt.pool import cores, progress_bar
from trajopt.store import Store, key

#: Nodes of the leg's angle, the pendulum's angle, the leg's rate and the pendulum's rate.
COUNTS = (13, 36, 25, 61)

#: The grid's rates reach so much further than the gait's own.
RATES = 1.3

#: Distance of the outermost nodes from the guards of touchdown (rad), which they must not cross.
INSIDE = 1e-6

#: How many voltages there are to choose from, and for how long one is held (s).
VOLTAGES, HOLD = 9, 4 * CONTROL_PERIOD

#: Fewest nodes of the grid from which a law acts. Within `NEAR` of a gait whose pendulum hardly
#: moves lie a few at some speeds, and none at others.
FEWEST = 10

#: Of a gait with the highest return, distance is rewarded by at least so many costs of transport.
LEAST_WORTH = 2.0

#: A foot without any normal force costs as much as so much time (s); less in proportion up to
#: `CONTACT_MARGIN`.
UNLOADED = 0.5

#: The cost (m) of a state from which nothing leads to the gait.
NEVER = 20.0

#: The cost (m) of a voltage that leads to a fall: more than any other, and finite, so that costs
#: can be compared where all of them do.
FALL = 2 * NEVER

#: Most sweeps, and the largest change (m) at which they have converged.
SWEEPS, CONVERGED = 400, 1e-3

#: A voltage that costs more than the best by so much time (s) counts 1/e of it.
SOFTNESS = 0.01

#: Wheels that are simulated at a time.
BATCH = 1 << 15

#: Controllers that are cached in memory (6 MB each).
MOST_CACHED = 8

#: Highest index of a cell of the grid, as a share of a cell less than the last node's.
_LAST = 1.0 - 1e-9


class Weights(NamedTuple):
    """Of a cost in metres of return."""

    time: float  # of a second
    energy: float  # of a joule that is drawn from the battery, without regeneration
    distance: float  # of a metre; negative, since distance is rewarded


def lost_return(params: WheelParams, speed: float, cot: float) -> Weights:
    """The weights by which a start-up costs what it loses of the return on a gait.

    A gait of a high cost of transport has not the highest return: others have more, so that it
    would be best never to arrive. Of such a gait the weights are those of the time alone.
    """
    worth = USUAL_TASK.distance_weight
    if worth < LEAST_WORTH * cot:
        return Weights(worth * speed, 0.0, 0.0)
    return Weights((worth - cot) * speed, 1.0 / params.weight, -worth)


def near_for(params: WheelParams, orbit: Orbit) -> float:
    """The distance from a gait up to which a law acts: `NEAR`, or that of `FEWEST` nodes.

    Laws hold a gait whose pendulum hardly moves from several of its small standard deviations.
    """
    nodes = np.ascontiguousarray(_grid(params, orbit, COUNTS).single()[:, :4])
    following = np.partition(squared_distances(nodes, orbit), FEWEST)[FEWEST]
    return max(NEAR, float(np.sqrt(following)))


class StateGrid(NamedTuple):
    """Nodes of the four coordinates, evenly spaced; the pendulum's angle goes round.

    In double stance the leg's angle and rate are known, so that the pendulum's nodes will do.
    """

    low: Floats  # of each coordinate's first node, shape (4,)
    spacing: Floats  # shape (4,)
    counts: np.ndarray  # of nodes, shape (4,)

    @classmethod
    def over(cls, params: WheelParams, rates: Sequence[float], counts: Sequence[int]) -> StateGrid:
        """The grid of a machine, up to these rates of the leg and of the pendulum (rad/s)."""
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


class CostToGo(NamedTuple):
    """The least cost on the way to a gait (m of return), at the nodes of a `StateGrid`."""

    single: Floats  # in single stance, shape `counts`
    double: Floats  # in double stance, shape (counts[1], counts[3])


@dataclasses.dataclass(frozen=True, repr=False)
class StartUpController:
    """The voltage after which about the least cost remains."""

    params: WheelParams  # the machine
    grid: StateGrid  # of the cost to go
    to_go: CostToGo  # the cost to go
    weights: Weights  # of the cost

    @classmethod
    def to(
        cls,
        params: WheelParams,
        orbit: Orbit,
        near: float,
        weights: Weights,
        counts: Sequence[int] | None = None,
    ) -> StartUpController:
        """The controller that leads to a gait; it takes some seconds to a minute to compute.

        Args:
            params: the machine.
            orbit: of the gait.
            near: distance from the gait at which another controller takes over; > 0.
            weights: of the cost to minimise.
            counts: of the grid's nodes of each coordinate, default `COUNTS`.
        """
        require_kind("orbit", orbit, Orbit)
        near, counts = positive("near", near), tuple(COUNTS if counts is None else counts)
        grid = _grid(params, orbit, counts)
        nodes = np.ascontiguousarray(grid.single()[:, :4])
        at_the_gait = squared_distances(nodes, orbit) < near**2
        if not at_the_gait.any():
            raise ValueError(
                f"near = {near:g}, counts = {counts}: no node of the grid lies so near the gait, "
                "and nothing could lead there; take a slower gait, or raise the counts or near"
            )
        return cls(params, grid, cost_to_gait(params, grid, at_the_gait, weights), weights)

    def __call__(self, x: ArrayLike, mode: ArrayLike = SINGLE) -> Floats:
        """Voltages for states; arguments, result and errors are those of a `Law`."""
        smooth, modes = states_and_modes(x, mode)
        states, choices = hybrid_states(smooth, modes), voltages(self.params)
        repeated = np.repeat(states, len(choices), axis=0)
        after, cost = simulated(self.params, repeated, np.tile(choices, len(states)), self.weights)
        remaining = _remaining(after, cost, self.to_go, self.grid)
        more = remaining.reshape(len(states), len(choices))
        more -= more.min(axis=1, keepdims=True)
        shares = np.exp(-more / (SOFTNESS * self.weights.time))
        mean = (shares * choices).sum(axis=1) / shares.sum(axis=1)
        return np.asarray(mean if np.ndim(x) == 2 else mean[0])


def _grid(params: WheelParams, orbit: Orbit, counts: Sequence[int]) -> StateGrid:
    """The grid for the controller that leads to a gait."""
    rates = RATES * np.abs(orbit.states[:, 2:]).max(axis=0)
    return StateGrid.over(params, rates, counts)


_CACHE: dict[str, StartUpController] = {}


def startup_for(
    params: WheelParams, orbit: Orbit, near: float, weights: Weights, folder: Path | None = None
) -> StartUpController:
    """`StartUpController.to`, computed once for the last few gaits.

    Args:
        params: the machine.
        orbit: of the gait.
        near: distance from the gait at which another controller takes over; > 0.
        weights: of the cost to minimise.
        folder: where the cost to go is also stored, and read from if it is there.
    """
    states = orbit.states
    name = key("startup", params=params, near=near, counts=COUNTS, orbit=states, cost=weights)
    startup, store = _CACHE.pop(name, None), None if folder is None else Store(folder)
    if startup is None and store is not None and name in store:
        to_go = CostToGo(**store.load(name))
        startup = StartUpController(params, _grid(params, orbit, COUNTS), to_go, weights)
    if startup is None:
        startup = StartUpController.to(params, orbit, near, weights)
        if store is not None:
            store.save(name, startup.to_go._asdict())
    _CACHE[name] = startup  # the last one is the one that was used last
    while len(_CACHE) > MOST_CACHED:
        _CACHE.pop(next(iter(_CACHE)))
    return startup


def voltages(params: WheelParams) -> Floats:
    """Those to choose from (V), evenly spread between a machine's limits, shape (VOLTAGES,)."""
    return np.linspace(-params.voltage_limit, params.voltage_limit, VOLTAGES)


def simulated(
    params: WheelParams, states: Floats, volts: Floats, weights: Weights
) -> tuple[Floats, Floats]:
    """Hold voltages (N,) for a moment from hybrid states (N, STATE_SIZE).

    Returns:
        The states afterwards, and the cost with penalties, (N,), infinite for a fall.
    """
    after, cost = states.copy(), np.empty(len(states))
    margin = CONTACT_MARGIN * params.weight

    def simulate(begin: int) -> None:
        part = slice(begin, begin + BATCH)
        out = advance(params, after[part], volts[part], HOLD)
        lacking = np.clip(1.0 - out[:, ROW.min_normal_force] / margin, 0.0, 1.0)
        fallen = out[:, ROW.failure] != 0.0
        energy = out[:, ROW.electrical_positive] + params.idle_power * HOLD
        weighted = weights.energy * energy + weights.distance * out[:, ROW.distance]
        weighted += weights.time * (HOLD + UNLOADED * lacking)
        cost[part] = np.where(fallen, np.inf, weighted)

    if len(states) <= BATCH:
        simulate(0)
    else:
        with ThreadPoolExecutor(cores()) as threads:
            list(threads.map(simulate, range(0, len(states), BATCH)))
    return after, cost


class Outcomes(NamedTuple):
    """What the voltages lead to from n nodes."""

    states: NDArray[np.float32]  # smooth states and modes, shape (n, voltages, 5)
    cost: NDArray[np.float32]  # shape (n, voltages); infinite for a fall


def cost_to_gait(
    params: WheelParams, grid: StateGrid, at_the_gait: NDArray[np.bool_], weights: Weights
) -> CostToGo:
    """The least cost to a gait from all states, `NEVER` where nothing leads there.

    `at_the_gait` holds for the nodes of single stance there, in the order of `StateGrid.single`.
    """
    sweeps = progress_bar("start-up controller", iterable=range(SWEEPS), leave=False)
    single = _outcomes(params, grid.single(), weights)
    double = _outcomes(params, grid.double(), weights)
    counts = grid.counts
    start = np.where(at_the_gait, 0.0, NEVER)
    to_go = CostToGo(start.reshape(counts), np.full((counts[1], counts[3]), NEVER))
    open_single = np.flatnonzero(~at_the_gait & np.isfinite(single.cost).any(axis=1))
    open_double = np.flatnonzero(np.isfinite(double.cost).any(axis=1))
    for sweep in sweeps:
        order = 1 if sweep % 2 == 0 else -1
        change = max(
            _swept(to_go.single.reshape(-1), open_single[::order], single, to_go, grid),
            _swept(to_go.double.reshape(-1), open_double[::order], double, to_go, grid),
        )
        if change < CONVERGED:
            return to_go
    raise ValueError(
        f"the costs of the way to the gait still change by {change:.3g} m after {SWEEPS} sweeps; "
        f"wanted is {CONVERGED:g} m: choose another speed"
    )


def _outcomes(params: WheelParams, nodes: Floats, weights: Weights) -> Outcomes:
    """Hold every voltage from every node."""
    n, choices = len(nodes), voltages(params)
    states = np.empty((n, len(choices), 5), np.float32)
    cost = np.empty((n, len(choices)), np.float32)
    for k, volts in enumerate(choices):
        after, cost[:, k] = simulated(params, nodes, np.full(n, volts), weights)
        states[:, k, :4], states[:, k, 4] = after[:, :4], after[:, MODE]
    states[:, :, 1] = np.mod(states[:, :, 1], 2 * np.pi)
    return Outcomes(states, cost)


@cached()
def _swept(flat, nodes, outcomes, to_go, grid):  # type: ignore[no-untyped-def]
    """Improve the costs at nodes, one after the other; the largest change."""
    largest = 0.0
    for i in nodes:
        least = NEVER
        for k in range(outcomes.cost.shape[1]):
            if outcomes.cost[i, k] < least:
                x = outcomes.states[i, k]
                ahead = cost_at(to_go, grid, x[0], x[1], x[2], x[3], x[4])
                least = min(least, outcomes.cost[i, k] + ahead)
        largest = max(largest, flat[i] - least)
        flat[i] = least
    return largest


@cached()
def _remaining(states, cost, to_go, grid):  # type: ignore[no-untyped-def]
    total = np.empty(len(cost))
    for i in range(len(cost)):
        x = states[i]
        ahead = cost_at(to_go, grid, x[0], x[1], x[2], x[3], x[MODE])
        total[i] = min(cost[i] + min(ahead, NEVER), FALL)
    return total


@inner
def cost_at(to_go, grid, phi, theta, dphi, dtheta, mode):  # type: ignore[no-untyped-def]
    """The cost to go, linear between nodes; beyond the grid it is as at its edge."""
    j, g = _cell_round(theta, grid, 1)
    m, i = _cell(dtheta, grid, 3)
    following = j + 1 if j + 1 < grid.counts[1] else 0
    if mode == DOUBLE:
        v = to_go.double
        return (1 - g) * _line(v[j], m, i) + g * _line(v[following], m, i)
    k, f = _cell(phi, grid, 0)
    n, h = _cell(dphi, grid, 2)
    total = 0.0
    for side in range(2):
        v, weight = to_go.single[k + side], f if side else 1 - f
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
