"""Independent forward simulation of a solution: an adaptive integrator follows its controls.

A solver's "success" does not say that the motion is accurate. Every phase is integrated from its
own start; and the phases are integrated one after the other, from the start of the first one
through the linkages. The cost is a quadrature along the way.

Along an unstable motion errors grow, until a simulation shows no more than its own rounding. It is
begun again from the solution wherever errors may have grown by `MOST_GROWTH`.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from rimless_gym.crossings import with_zeros
from trajopt.ocp.accuracy import mean_slopes
from trajopt.ocp.arrays import Array
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.scaling import PhaseScales, Scales
from trajopt.ocp.trajectory import PhaseTrajectory

#: Tolerances of the integrator, the second relative to the scales.
RTOL, ATOL = 1e-11, 1e-12

#: By what errors may grow before a simulation is begun again.
MOST_GROWTH = 1e3

#: Evaluations of the flow after which the simulation of a phase is given up, some seconds' worth.
EFFORT = 100_000


@dataclasses.dataclass(frozen=True)
class Resimulation:
    """What a forward simulation of a solution gives.

    Attributes:
        phase_errors: largest deviation from the solution's states, relative to their scales, of
            each phase simulated from its own start.
        chain_error: the same with each phase simulated from where the one before ended, where
            a linkage leads from phase i to i + 1; without such linkages, the largest phase error.
        cost: integrals and endpoint cost along the phases, each simulated from its own start.
        spans: how often the simulation of each phase was begun, the first time at its start.
        growth: by how many orders of magnitude an error grows over each phase.
    """

    phase_errors: tuple[float, ...]
    chain_error: float
    cost: float
    spans: tuple[int, ...]
    growth: tuple[float, ...]


def resimulate(
    problem: Problem, phases: Sequence[PhaseTrajectory], p: Array, scales: Scales
) -> Resimulation:
    """Simulate a solution, phase by phase and as a chain."""
    errors, chain, cost, ends, divisions = [], [], 0.0, [], []
    following = {k.source: k for k in problem.linkages if k.target == k.source + 1}
    start = phases[0].start
    for i, (phase, trajectory) in enumerate(zip(problem.phases, phases, strict=True)):
        divisions.append(_divided(phase, trajectory, p, scales.phases[i]))
        units = scales.phases[i], scales.cost, divisions[-1][0]
        error, end, integral = simulate_phase(phase, trajectory, trajectory.start, p, *units)
        errors.append(error)
        ends.append(end)
        cost += integral
        if not np.array_equal(start, trajectory.start):
            error, end, _ = simulate_phase(phase, trajectory, start, p, *units)
        chain.append(error)
        if i in following:
            link = following[i]
            start = link.map(end, p).full().ravel() + problem.offset(link)
        elif i + 1 < len(phases):
            start = phases[i + 1].start
    if problem.endpoint_cost is not None:
        starts = np.concatenate([t.start for t in phases])
        durations = np.array([t.duration for t in phases])
        cost += float(problem.endpoint_cost(starts, np.concatenate(ends), durations, p))
    return Resimulation(
        phase_errors=tuple(errors),
        chain_error=max(chain),
        cost=cost,
        spans=tuple(1 + sum(piece.anew for piece in pieces) for pieces, _ in divisions),
        growth=tuple(growth for _, growth in divisions),
    )


class Piece(NamedTuple):
    """An element, or a part of one, that is simulated at once."""

    element: int  # its index
    begin: float  # when it begins (s)
    end: float  # when it ends (s)
    anew: bool = False  # whether the simulation is begun again at its begin


def _divided(
    phase: Phase, trajectory: PhaseTrajectory, p: Array, scales: PhaseScales
) -> tuple[list[Piece], float]:
    """A phase in pieces, and by how many orders of magnitude an error grows over all of them.

    The growth is that of the linearised motion, with each element's mean derivatives.
    """
    nx, h = len(phase.states), trajectory.element_durations
    mean = mean_slopes(phase, trajectory, p) * (scales.states / scales.states[:, None])
    pieces: list[Piece] = []
    since, decades, most = np.eye(nx), 0.0, math.log10(MOST_GROWTH)
    for e, A in enumerate(mean):
        rate = np.linalg.eigvals(A).real.max()
        parts = max(math.ceil(rate * h[e] / math.log(10) / most), 1)
        step = expm(A * h[e] / parts)
        edges = np.linspace(trajectory.edges[e], trajectory.edges[e + 1], parts + 1).tolist()
        for begin, end in itertools.pairwise(edges):
            anew = bool(np.linalg.norm(step @ since, 2) > MOST_GROWTH and pieces)
            if anew:
                decades += _decades(since)
                since = np.eye(nx)
            since = step @ since
            pieces.append(Piece(e, begin, end, anew))
    return pieces, decades + _decades(since)


def _decades(matrix: Array) -> float:
    return math.log10(max(np.linalg.norm(matrix, 2), np.finfo(float).tiny))


class _TooStiffError(Exception):
    """An explicit integrator cannot follow the motion in reasonable time."""


def simulate_phase(
    phase: Phase,
    trajectory: PhaseTrajectory,
    start: Array,
    p: Array,
    scales: PhaseScales,
    cost_scale: float,
    pieces: Sequence[Piece],
) -> tuple[float, Array, float]:
    """Simulate a phase from `start`: largest deviation from its states, the end, the cost."""
    y, error = np.append(start, 0.0), 0.0
    atol = ATOL * np.r_[scales.states, cost_scale, np.full_like(scales.powers, cost_scale)]
    for times, values in _simulated_pieces(phase, trajectory, start, p, atol, pieces):
        inside = trajectory.state(np.minimum(times, trajectory.duration))
        error = max(error, float((np.abs(values[:, :-1] - inside) / scales.states).max()))
        y = values[-1]
    return error, y[:-1], float(y[-1])


def _simulated_pieces(
    phase: Phase,
    trajectory: PhaseTrajectory,
    start: Array,
    p: Array,
    atol: Array,
    pieces: Sequence[Piece],
) -> Iterator[tuple[Array, Array]]:
    """For every piece times (9,), and there the states and the cost so far (9, nx + 1).

    Where the integrator fails or takes more than `EFFORT` evaluations, these are infinite and the
    piece is the last.
    """
    nx, effort, cost = len(phase.states), itertools.count(), 0.0
    surplus = _running_cost(phase, start, trajectory.controls[0, 0], p)[1]
    y = np.concatenate([start, [0.0], np.zeros_like(surplus)])
    coefficients = np.linalg.solve(
        np.vander(trajectory.control_nodes), trajectory.controls
    )  # (M, m, nu)
    for e, begin, end, anew in pieces:
        control = _polynomial(coefficients[e], *trajectory.edges[e : e + 2])
        if anew:
            y = np.concatenate([trajectory.state(begin)[0], y[nx:]])

        def rates(t: float, y: Array, control: _Control = control) -> Array:
            if next(effort) > EFFORT:
                raise _TooStiffError
            x, u = y[:nx], control(t)
            flow = phase.flow(x, u, p).full().ravel()
            return np.concatenate([flow, *np.atleast_1d(*_running_cost(phase, x, u, p))])

        times = begin + (end - begin) * np.linspace(0.0, 1.0, 9)
        times[-1] = end
        settings: dict[str, Any] = {"rtol": RTOL, "atol": atol[: len(y)], "dense_output": True}
        try:
            run = solve_ivp(rates, (begin, end), y, "DOP853", **settings)
        except _TooStiffError:
            run = None
        if run is None or not run.success:
            yield times, np.full((9, nx + 1), np.inf)
            return

        def excess(times: Array, control: _Control = control, at: Any = run.sol) -> Array:
            states = at(times)[:nx].T
            costs = (
                _running_cost(phase, x, control(t), p) for t, x in zip(times, states, strict=True)
            )
            return np.array([surplus for _, surplus in costs])

        zeros = with_zeros(excess, np.union1d(times, run.t))
        work = np.maximum(np.diff(run.sol(zeros)[nx + 1 :]), 0.0).sum(axis=0)
        powers = np.interp(times, zeros, np.append(0.0, np.cumsum(work)))
        values = run.sol(times).T[:, : nx + 1]
        values[:, nx] += cost + powers
        yield times, values
        cost, y = cost + powers[-1], run.y[:, -1]


_Control: TypeAlias = Callable[[float], Array]


def _polynomial(coefficients: Array, begin: float, end: float) -> _Control:
    h = end - begin

    def control(t: float) -> Array:
        u = coefficients[0]
        for c in coefficients[1:]:
            u = u * ((t - begin) / h) + c
        return np.asarray(u)

    return control


def _running_cost(phase: Phase, x: Array, u: Array, p: Array) -> tuple[float, Array]:
    """The smooth part of the running cost, and the powers' excesses over their floor (k,).

    Positive excesses are costs too; they are apart because their maximum with 0 has kinks.
    """
    smooth = 0.0 if phase.cost is None else float(phase.cost(x, u, p))
    if phase.powers is None:
        return smooth, np.zeros(0)
    powers = phase.powers(x, u, p).full().ravel()
    if math.isinf(phase.floor):
        return smooth + float(powers.sum()), np.zeros(0)
    return smooth + phase.floor * len(powers), powers - phase.floor
