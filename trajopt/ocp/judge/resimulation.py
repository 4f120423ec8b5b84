"""A solution played back: an adaptive integrator follows its controls, and pays for them.

A solver's "success" is not accuracy. Every phase is integrated from its own start, and the phases
one after the other from the first one's start through the linkages; the cost is a quadrature along
the way. (A wheel's touchdowns are located by `rimless_gym.simulate` besides: `trajopt.gaits`.)
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from scipy.integrate import solve_ivp

from rimless_gym.zeros import with_zeros
from trajopt.ocp.pose.problem import Array, Phase, Problem
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

RTOL, ATOL = 1e-11, 1e-12

#: Evaluations of the motion that playing one phase back may take, some seconds' worth.
EFFORT = 100_000


@dataclasses.dataclass(frozen=True)
class Resimulation:
    """What playing a solution back gives.

    Attributes:
        phase_errors: largest deviation from the solution's states, each phase from its own start.
        chain_error: the same with each phase starting where the one before led, by the linkages
            from phase i to i + 1; equal to the largest phase error where there are none.
        cost: integrals and endpoint cost along the phases played back each from its own start.
    """

    phase_errors: tuple[float, ...]
    chain_error: float
    cost: float


def resimulated(problem: Problem, phases: Sequence[PhaseTrajectory], p: Array) -> Resimulation:
    """Play a solution back."""
    errors, chain, cost, ends = [], [], 0.0, []
    following = {k.source: k for k in problem.linkages if k.target == k.source + 1}
    start = phases[0].start
    for i, (phase, trajectory) in enumerate(zip(problem.phases, phases, strict=True)):
        error, end, paid = played(phase, trajectory, trajectory.start, p)
        errors.append(error)
        ends.append(end)
        cost += paid
        if np.array_equal(start, trajectory.start):
            chain.append(error)
        else:
            error, end, _ = played(phase, trajectory, start, p)
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


def played(
    phase: Phase, trajectory: PhaseTrajectory, start: Array, p: Array
) -> tuple[float, Array, float]:
    """One phase from `start`: largest deviation from its states, the end, and what was paid."""
    y, error = np.append(start, 0.0), 0.0
    for times, values in followed(phase, trajectory, start, p):
        inside = trajectory.state(np.minimum(times, trajectory.duration))
        error = max(error, float(np.abs(values[:, :-1] - inside).max()))
        y = values[-1]
    return error, y[:-1], float(y[-1])


def followed(
    phase: Phase,
    trajectory: PhaseTrajectory,
    start: Array,
    p: Array,
    rtol: float = RTOL,
    atol: float = ATOL,
) -> Iterator[tuple[Array, Array]]:
    """One phase from `start`: times (9,), and states and what was paid (9, nx + 1), by element.

    Infinite, and the last, where the integrator fails or takes more than `EFFORT`.
    """
    nx, effort, paid = len(phase.states), itertools.count(), 0.0
    surplus = _price(phase, start, trajectory.controls[0, 0], p)[1]
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
            return np.concatenate([flow, *np.atleast_1d(*_price(phase, x, u, p))])

        times = begin + (end - begin) * np.linspace(0.0, 1.0, 9)
        times[-1] = end
        settings: dict[str, Any] = {"rtol": rtol, "atol": atol, "dense_output": True}
        try:
            run = solve_ivp(rates, (begin, end), y, "DOP853", **settings)
        except _TooStiffError:
            run = None
        if run is None or not run.success:
            yield times, np.full((9, nx + 1), np.inf)
            return

        def excess(t: float, control: _Control = control, at: _Control = run.sol) -> Array:
            return _price(phase, at(t)[:nx], control(t), p)[1]

        marks = with_zeros(excess, np.union1d(times, run.t))
        work = np.maximum(np.diff(run.sol(marks)[nx + 1 :]), 0.0).sum(axis=0)
        drawn = np.interp(times, marks, np.append(0.0, np.cumsum(work)))
        values = run.sol(times).T[:, : nx + 1]
        values[:, nx] += paid + drawn
        yield times, values
        paid, y = paid + drawn[-1], run.y[:, -1]


_Control: TypeAlias = Callable[[float], Array]


def _polynomial(coefficients: Array, begin: float, h: float) -> _Control:
    def control(t: float) -> Array:
        u = coefficients[0]
        for c in coefficients[1:]:
            u = u * ((t - begin) / h) + c
        return np.asarray(u)

    return control


def _price(phase: Phase, x: Array, u: Array, p: Array) -> tuple[float, Array]:
    """The rate of payment at one point, and the powers' excesses over their floor (k,).

    Both are smooth. An excess is paid too, where it is positive.
    """
    paid = 0.0 if phase.cost is None else float(phase.cost(x, u, p))
    if phase.powers is None:
        return paid, np.zeros(0)
    powers = phase.powers(x, u, p).full().ravel()
    if math.isinf(phase.floor):
        return paid + float(powers.sum()), np.zeros(0)
    return paid + phase.floor * len(powers), powers - phase.floor
