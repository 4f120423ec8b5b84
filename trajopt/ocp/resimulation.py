"""Independent forward simulation of a solution: an adaptive integrator follows its controls.

A solver's "success" does not say that the motion is accurate. Every phase is integrated from its
own start; and the phases are integrated one after the other, from the start of the first one
through the linkages. The cost is a quadrature along the way.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from scipy.integrate import solve_ivp

from rimless_gym.crossings import with_zeros
from trajopt.ocp.arrays import Array
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.trajectory import PhaseTrajectory

#: Tolerances of the integrator.
RTOL, ATOL = 1e-11, 1e-12

#: Evaluations of the flow after which the simulation of a phase is given up, some seconds' worth.
EFFORT = 100_000


@dataclasses.dataclass(frozen=True)
class Resimulation:
    """What a forward simulation of a solution gives.

    Attributes:
        phase_errors: largest deviation from the solution's states, of each phase simulated from
            its own start.
        chain_error: the same with each phase simulated from where the one before ended, where
            a linkage leads from phase i to i + 1; without such linkages, the largest phase error.
        cost: integrals and endpoint cost along the phases, each simulated from its own start.
    """

    phase_errors: tuple[float, ...]
    chain_error: float
    cost: float


def resimulate(problem: Problem, phases: Sequence[PhaseTrajectory], p: Array) -> Resimulation:
    """Simulate a solution, phase by phase and as a chain."""
    errors, chain, cost, ends = [], [], 0.0, []
    following = {k.source: k for k in problem.linkages if k.target == k.source + 1}
    start = phases[0].start
    for i, (phase, trajectory) in enumerate(zip(problem.phases, phases, strict=True)):
        error, end, integral = simulate_phase(phase, trajectory, trajectory.start, p)
        errors.append(error)
        ends.append(end)
        cost += integral
        if np.array_equal(start, trajectory.start):
            chain.append(error)
        else:
            error, end, _ = simulate_phase(phase, trajectory, start, p)
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
    return Resimulation(tuple(errors), max(chain), cost)


class _TooStiffError(Exception):
    """An explicit integrator cannot follow the motion in reasonable time."""


def simulate_phase(
    phase: Phase, trajectory: PhaseTrajectory, start: Array, p: Array
) -> tuple[float, Array, float]:
    """Simulate a phase from `start`: largest deviation from its states, the end, the cost."""
    y, error = np.append(start, 0.0), 0.0
    for times, values in _simulated_elements(phase, trajectory, start, p):
        inside = trajectory.state(np.minimum(times, trajectory.duration))
        error = max(error, float(np.abs(values[:, :-1] - inside).max()))
        y = values[-1]
    return error, y[:-1], float(y[-1])


def _simulated_elements(
    phase: Phase, trajectory: PhaseTrajectory, start: Array, p: Array
) -> Iterator[tuple[Array, Array]]:
    """For every element times (9,), and there the states and the cost so far (9, nx + 1).

    Where the integrator fails or takes more than `EFFORT` evaluations, these are infinite and the
    element is the last.
    """
    nx, effort, cost = len(phase.states), itertools.count(), 0.0
    surplus = _running_cost(phase, start, trajectory.controls[0, 0], p)[1]
    y = np.concatenate([start, [0.0], np.zeros_like(surplus)])
    coefficients = np.linalg.solve(
        np.vander(trajectory.control_nodes), trajectory.controls
    )  # (M, m, nu)
    for e, (begin, end) in enumerate(zip(trajectory.edges, trajectory.edges[1:], strict=False)):
        control = _polynomial(coefficients[e], begin, end - begin)

        def rates(t: float, y: Array, control: _Control = control) -> Array:
            if next(effort) > EFFORT:
                raise _TooStiffError
            x, u = y[:nx], control(t)
            flow = phase.flow(x, u, p).full().ravel()
            return np.concatenate([flow, *np.atleast_1d(*_running_cost(phase, x, u, p))])

        times = begin + (end - begin) * np.linspace(0.0, 1.0, 9)
        times[-1] = end
        settings: dict[str, Any] = {"rtol": RTOL, "atol": ATOL, "dense_output": True}
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


def _polynomial(coefficients: Array, begin: float, h: float) -> _Control:
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
