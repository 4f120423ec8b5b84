"""hp mesh refinement: higher degrees where the solution is smooth, more elements where it is not.

After Patterson, Hager and Rao, A ph mesh refinement method for optimal control, Optim. Control
Appl. Methods 36 (2015), with splits at the control's own switches.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from trajopt.accuracy import Quality
from trajopt.mesh import FIXED_DEGREE, Mesh
from trajopt.packing import evaluated
from trajopt.problem import Array, Phase, Problem
from trajopt.schemes.polynomials import full_differentiation_matrix, lagrange_matrix
from trajopt.trajectory import PhaseTrajectory

MAX_DEGREE = 12
MAX_ELEMENTS = 400

#: Elements shorter than this fraction of their phase are split no further.
SHORTEST = 1e-5

#: The same for the sake of the Hamiltonian: a control that may switch on shorter elements cheats.
SHORTEST_CERTIFIED = 1e-3

#: Path constraints violated by more than this between nodes ask for a finer mesh; what is less is
#: left to margins (`trajopt.solve`), for where a control switches no mesh is fine enough.
COARSE = 1e-3

#: Where a fall of the Legendre coefficients by less than this per degree says "not smooth".
DECAY = 0.5

#: Legendre coefficients below this, relative to the range over the phase, are noise.
NEGLIGIBLE = 1e-7

#: Neighbours' controls, continued into an element, that differ by less than this, relative to the
#: control's range, do not break there.
NO_BREAK = 0.01

#: Errors, in tolerances, beyond which it is all one: an unstable motion's may overflow.
HOPELESS = 1e15

_SEARCHED = np.linspace(0.0, 1.0, 101)


def refined(
    mesh: Mesh,
    problem: Problem,
    phases: Sequence[PhaseTrajectory],
    p: Array,
    qualities: Sequence[Quality],
    state_tolerance: float,
    cost_tolerance: float,
    limit_tolerance: float,
) -> Mesh:
    """A finer mesh where a tolerance is missed; the same mesh if none is, or the caps forbid it.

    An element in which the control switches (it jumps and costs too much, a power changes sign, a
    bound is met or left) is split there. Else, if states and controls are smooth, its degree rises
    by as much as the error asks for; if they are not, or the degree is at its cap, it is halved.
    """
    fractions, degrees = [], []
    room = MAX_ELEMENTS - mesh.elements
    for i, (phase, trajectory, quality) in enumerate(
        zip(problem.phases, phases, qualities, strict=True)
    ):
        edges, orders = [0.0], []
        limits = np.maximum(
            quality.limit_violation / limit_tolerance, quality.path_violation.max(axis=1) / COARSE
        )
        for e, degree in enumerate(mesh.degrees[i]):
            left, right = mesh.fractions[i][e : e + 2]
            excess = max(
                quality.state_error[e] / state_tolerance, quality.cost_error[e] / cost_tolerance
            )
            wasteful = quality.cost_gap[e] > cost_tolerance
            jumps, inside = breaks(trajectory, e) if wasteful else [], []
            if jumps or max(excess, limits[e]) > 1.0:
                raised = degree + max(1, int(np.ceil(np.log10(np.clip(excess, 1.0, HOPELESS)))))
                fixed = mesh.scheme in FIXED_DEGREE
                switches = switch_points(phase, trajectory, e, p)
                smooth = not fixed and is_smooth(trajectory, e) and not switches
                if smooth and raised <= MAX_DEGREE and excess > 1.0:
                    degree = raised
                elif right - left > SHORTEST and room > 0:
                    inside = jumps or switches or [0.5]
                    room -= len(inside)
            edges += [left + (right - left) * s for s in inside] + [right]
            orders += [degree] * (len(inside) + 1)
        fractions.append(tuple(edges))
        degrees.append(tuple(orders))
    return dataclasses.replace(mesh, fractions=tuple(fractions), degrees=tuple(degrees))


def certified(mesh: Mesh, hamiltonian: Sequence[Array], tolerance: float) -> Mesh:
    """Halve the elements over which the Hamiltonian changes: an optimal control switches in there.

    Args:
        mesh: to refine.
        hamiltonian: at both ends of every element, (M, 2) per phase.
        tolerance: of its change over an element, relative to 1 + its median's magnitude.
    """
    fractions, degrees = [], []
    for edges, orders, values in zip(mesh.fractions, mesh.degrees, hamiltonian, strict=True):
        drift = np.abs(values[:, 1] - values[:, 0]) / (1.0 + abs(np.median(values)))
        split = (drift > tolerance) & (np.diff(edges) > SHORTEST_CERTIFIED)
        middles = 0.5 * (np.array(edges[1:]) + np.array(edges[:-1]))
        fractions.append(tuple(sorted([*edges, *middles[split].tolist()])))
        degrees.append(tuple(np.repeat(orders, 1 + split).tolist()))
    return dataclasses.replace(mesh, fractions=tuple(fractions), degrees=tuple(degrees))


def breaks(trajectory: PhaseTrajectory, element: int) -> list[float]:
    """The fraction of an element at which a control jumps or has a kink, if one does.

    The neighbours' controls, continued straight on, meet at a kink. If they do not, the control
    jumps from one to the other where that leaves the element's mean control as it is; near an
    edge the element is cut beyond the jump, to be sure that the rest has none.
    """
    u, h = trajectory.controls, trajectory.element_durations
    if not u.shape[-1]:
        return []
    slope = full_differentiation_matrix(tuple(trajectory.control_nodes))
    last, first = max(element - 1, 0), min(element + 1, len(u) - 1)
    before, after = u[last, -1 if last < element else 0], u[first, 0 if first > element else -1]
    rise = h[element] * (slope[-1] @ u[last] / h[last]) * (last < element)
    fall = h[element] * (slope[0] @ u[first] / h[first]) * (first > element)
    gap = np.array([after - fall - before, after - before - rise])  # at the element's edges
    apart = np.abs(gap).max(axis=0) / (np.ptp(u, axis=(0, 1)) + np.finfo(float).tiny)
    k = int(np.argmax(apart))
    if apart[k] < NO_BREAK:
        return []
    left, right = gap[:, k]
    if left * right < 0.0:
        s = left / (left - right)
    else:
        points, weights = np.polynomial.legendre.leggauss(len(trajectory.control_nodes))
        values = lagrange_matrix(trajectory.control_nodes, 0.5 + 0.5 * points) @ u[element, :, k]
        s = (0.5 * weights @ values - after[k]) / (before[k] - after[k])
        s = 2 * s if s < 0.1 else 2 * s - 1 if s > 0.9 else s
    return [float(s)] if 0.005 < s < 0.995 else []


def switch_points(phase: Phase, trajectory: PhaseTrajectory, element: int, p: Array) -> list[float]:
    """Fractions of an element at which a power passes its floor, or a control meets its bound."""
    u = lagrange_matrix(trajectory.control_nodes, _SEARCHED) @ trajectory.controls[element]
    x = lagrange_matrix(trajectory.nodes, _SEARCHED) @ trajectory.states[element]
    signals = []
    if phase.powers is not None and np.isfinite(phase.floor):
        signals.append(evaluated(phase.powers, x, u, p) - phase.floor)
    lower, upper = phase.control_bounds()
    near = 1e-3 * np.ptp(trajectory.controls, axis=(0, 1))
    bounded = [u - lower - near, upper - near - u]
    signals += [s[:, np.isfinite(s).all(axis=0)] for s in bounded]
    found: set[float] = set()
    for values in np.concatenate(signals, axis=1).T:
        for k in np.flatnonzero(values[:-1] * values[1:] < 0.0):
            s = _SEARCHED[k] + 0.01 * values[k] / (values[k] - values[k + 1])
            if 0.05 < s < 0.95 and all(abs(s - other) > 0.05 for other in found):
                found.add(float(s))
    return sorted(found)


def is_smooth(trajectory: PhaseTrajectory, element: int) -> bool:
    """Whether the Legendre coefficients of an element's states and controls fall fast enough."""
    return _fall(trajectory.nodes, trajectory.states, element) and _fall(
        trajectory.control_nodes, trajectory.controls, element
    )


def _fall(nodes: Array, values: Array, element: int) -> bool:
    """Of the polynomials through values (M, n, m); what is tiny for the phase is as good as 0."""
    n = len(nodes)
    if n < 4 or not values.shape[-1]:
        return True
    basis = np.polynomial.legendre.legvander(2 * nodes - 1, n - 1)
    range_ = np.ptp(values, axis=(0, 1)) + np.finfo(float).tiny
    high = np.abs(np.linalg.solve(basis, values[element]) / range_).max(axis=1)[2:]
    decay = np.polyfit(np.arange(len(high)), np.log(high + NEGLIGIBLE), 1)[0]
    return bool(np.exp(decay) < DECAY or high.max() < 10 * NEGLIGIBLE)
