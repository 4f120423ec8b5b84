"""hp mesh refinement: higher degrees where the solution is smooth, more elements where it is not.

After Patterson, Hager and Rao, A ph mesh refinement method for optimal control, Optim. Control
Appl. Methods 36 (2015), with splits at the control's own switches.

No decision depends on rounding or on the digits that a solver leaves open, because these differ
between processors. Every quantity has its own scale, and values tiny beside it count as zero.
Thresholds are moved off zero, off ties and off round numbers.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from trajopt.ocp.judge.accuracy import Quality
from trajopt.ocp.pose.problem import Array, Phase, Problem
from trajopt.ocp.solving.ties import least_first
from trajopt.ocp.transcribe.mesh import FIXED_DEGREE, Mesh
from trajopt.ocp.transcribe.packing import evaluated
from trajopt.ocp.transcribe.schemes.polynomials import full_differentiation_matrix, lagrange_matrix
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

MAX_DEGREE = 12
MAX_ELEMENTS = 400

#: Elements that are not clearly longer than this fraction of their phase are split no further.
SHORTEST = 1e-5

#: The same for the sake of the Hamiltonian: a control that may switch on shorter elements cheats.
SHORTEST_CERTIFIED = 1e-3

#: What "clearly" is, relative: the widths of equal elements differ by rounding, and errors of the
#: elements of a symmetrical solution by what a solver leaves open.
CLEARLY, WORSE = 1e-6, 1e-2

#: Path constraints violated by more than this between nodes ask for a finer mesh; what is less is
#: left to margins (`solving.solve`), for where a control switches no mesh is fine enough.
COARSE = 1e-3

#: Where a fall of the Legendre coefficients by less than this per degree says "not smooth".
DECAY = 0.5

#: Legendre coefficients below this, relative to the range over the phase, are noise; so are powers
#: and controls, relative to 1 + their largest magnitude over the phase.
NEGLIGIBLE = 1e-7

#: A range is taken to be at least this, relative to 1 + the largest magnitude over the phase: the
#: range of what is constant is rounding.
CONSTANT = 1e-3

#: Neighbours' controls, continued into an element, that differ by less than this, relative to the
#: control's range, do not break there; nor does a control jump by less.
NO_BREAK = 0.01

#: Breaks nearer to an edge than this fraction of their element are at the edge, where nothing needs
#: to be split, and jumps nearer than the second are cut off together with a margin.
AT_EDGE, NEAR_EDGE = 0.005, 0.1

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
    Where there is no room to split all, the worst are.
    """
    fractions, degrees = [], []
    room, fixed = max(MAX_ELEMENTS - mesh.elements, 0), mesh.scheme in FIXED_DEGREE
    pairs = zip(problem.phases, qualities, strict=True)
    limits = [_limits(phase, quality, limit_tolerance) for phase, quality in pairs]
    tolerances = state_tolerance, cost_tolerance
    misses = [_misses(*each, *tolerances) for each in zip(qualities, limits, strict=True)]
    everywhere = [(i, e) for i, each in enumerate(misses) for e in range(len(each))]
    worst = set(least_first(everywhere, lambda at: -misses[at[0]][at[1]], WORSE)[:room])
    for i, (phase, trajectory, quality) in enumerate(
        zip(problem.phases, phases, qualities, strict=True)
    ):
        edges, orders = [0.0], []
        for e, degree in enumerate(mesh.degrees[i]):
            left, right = mesh.fractions[i][e : e + 2]
            excess = max(
                quality.state_error[e] / state_tolerance, quality.cost_error[e] / cost_tolerance
            )
            wasteful = quality.cost_gap[e] > cost_tolerance
            jumps, inside = breaks(trajectory, e) if wasteful else [], []
            if jumps or max(excess, limits[i][e]) > 1.0:
                digits = math.log10(np.clip(excess, 1.0, 1e99))
                raised = degree + max(1, math.ceil(digits - CLEARLY))
                switches = switch_points(phase, trajectory, e, p)
                smooth = not fixed and is_smooth(trajectory, e) and not switches
                if smooth and raised <= MAX_DEGREE and excess > max(1.0, limits[i][e]):
                    degree = raised
                elif _longer(right - left, SHORTEST) and room > 0 and (i, e) in worst:
                    inside = jumps or switches or [0.5]
                    room -= len(inside)
            edges += [left + (right - left) * s for s in inside] + [right]
            orders += [degree] * (len(inside) + 1)
        fractions.append(tuple(edges))
        degrees.append(tuple(orders))
    return dataclasses.replace(mesh, fractions=tuple(fractions), degrees=tuple(degrees))


def _longer(width: Any, than: float) -> Any:
    return width > (1 + CLEARLY) * than


def _misses(
    quality: Quality, limits: Array, state_tolerance: float, cost_tolerance: float
) -> Array:
    """The worst of all errors of every element, relative to its tolerance, shape (M,)."""
    cost = np.maximum(quality.cost_error, quality.cost_gap) / cost_tolerance
    return np.max([quality.state_error / state_tolerance, cost, limits], axis=0)


def _limits(phase: Phase, quality: Quality, tolerance: float) -> Array:
    """Violations of limits relative to what asks for a finer mesh, shape (M,)."""
    asked: Any = COARSE
    if phase.path is not None:  # an equation has no room for margins
        asked = np.where(phase.path.lower == phase.path.upper, tolerance, COARSE)
    path = (quality.path_violation / asked).max(axis=1)
    return np.asarray(np.maximum(quality.limit_violation / tolerance, path))


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
        split = (drift > tolerance) & _longer(np.diff(edges), SHORTEST_CERTIFIED)
        middles = 0.5 * (np.array(edges[1:]) + np.array(edges[:-1]))
        fractions.append(tuple(sorted([*edges, *middles[split].tolist()])))
        degrees.append(tuple(np.repeat(orders, 1 + split).tolist()))
    return dataclasses.replace(mesh, fractions=tuple(fractions), degrees=tuple(degrees))


def breaks(trajectory: PhaseTrajectory, element: int) -> list[float]:
    """The fraction of an element at which a control jumps or has a kink, if one does.

    The neighbours' controls (its own at the phase's ends), continued straight on, meet at a kink;
    if they meet at an edge, there is none inside. If they do not meet, the control jumps from one
    to the other where that leaves the element's mean control as it is; near an edge the element is
    cut beyond the jump, to be sure that the rest has none. Of several controls the one counts that
    breaks most, the first if it is as good as that. (Controls that are linear on every element have
    kinks at their edges, and nothing to tell where others are.)
    """
    u, h = trajectory.controls, trajectory.element_durations
    if not u.shape[-1] or len(trajectory.control_nodes) < 3:
        return []
    slope = full_differentiation_matrix(tuple(trajectory.control_nodes))
    last, first = max(element - 1, 0), min(element + 1, len(u) - 1)
    i, j = (-1 if last < element else 0), (0 if first > element else -1)
    before, rise = u[last, i], h[element] / h[last] * (slope[i] @ u[last])
    after, fall = u[first, j], h[element] / h[first] * (slope[j] @ u[first])
    ranges = _ranges(u)
    gap = np.array([after - fall - before, after - before - rise]) / ranges  # at its edges
    apart = np.abs(gap).max(axis=0)
    k = int(np.argmax(apart > (1 - WORSE) * apart.max()))
    if apart[k] < NO_BREAK:
        return []
    left, right = gap[:, k]
    jump = (before[k] - after[k]) / ranges[k]
    if min(abs(left), abs(right)) < AT_EDGE * apart[k]:
        return []
    if left * right < 0.0:
        s = left / (left - right)
    elif abs(jump) > NO_BREAK:
        points, weights = np.polynomial.legendre.leggauss(len(trajectory.control_nodes))
        values = lagrange_matrix(trajectory.control_nodes, 0.5 + 0.5 * points) @ u[element, :, k]
        s = (0.5 * weights @ values - after[k]) / (jump * ranges[k])
        s = min(max(s, min(2 * s, NEAR_EDGE)), max(2 * s - 1, 1 - NEAR_EDGE))
    else:
        return []
    return [float(s)] if AT_EDGE < s < 1 - AT_EDGE else []


def _scale(values: Array) -> Array:
    """1 + the largest magnitude (m,) over a phase of values (M, n, m), as for errors of states."""
    return np.asarray(1.0 + np.abs(values).max(axis=(0, 1)))


def _ranges(values: Array) -> Array:
    """Ranges (m,) over a phase of values (M, n, m), none below `CONSTANT`."""
    return np.maximum(np.ptp(values, axis=(0, 1)), CONSTANT * _scale(values))


def switch_points(phase: Phase, trajectory: PhaseTrajectory, element: int, p: Array) -> list[float]:
    """Fractions of an element at which a power passes its floor, or a control meets its bound."""
    u = lagrange_matrix(trajectory.control_nodes, _SEARCHED) @ trajectory.controls[element]
    x = lagrange_matrix(trajectory.nodes, _SEARCHED) @ trajectory.states[element]
    signals, noise = [], []
    if phase.powers is not None and np.isfinite(phase.floor):
        everywhere = evaluated(phase.powers, *_at_control_nodes(trajectory), p)
        signals.append(evaluated(phase.powers, x, u, p) - phase.floor)
        noise.append(NEGLIGIBLE * _scale(everywhere))
    lower, upper = phase.control_bounds()
    near = 1e-3 * _ranges(trajectory.controls)
    signals += [u - lower - near, upper - near - u]
    noise += [NEGLIGIBLE * _scale(trajectory.controls)] * 2
    found: set[float] = set()
    for values, least in zip(np.concatenate(signals, axis=1).T, np.concatenate(noise), strict=True):
        for s in _passes(values, least) if np.isfinite(values).all() else []:
            if 0.05 < s < 0.95 and all(abs(s - other) > 0.05 for other in found):
                found.add(s)
    return sorted(found)


def _passes(values: Array, noise: float) -> list[float]:
    """Where values at `_SEARCHED` pass from clearly positive to clearly negative, or back.

    If they are noise on the way, the middle of that.
    """
    clear = np.flatnonzero(np.abs(values) > noise)
    passing = np.flatnonzero(np.diff(np.sign(values[clear])))
    found = []
    for k, m in zip(clear[passing], clear[passing + 1], strict=True):
        between = _SEARCHED[k + 1 : m]
        zero = _SEARCHED[k] + values[k] / (values[k] - values[m]) * (_SEARCHED[m] - _SEARCHED[k])
        found.append(float(between.mean() if len(between) else zero))
    return found


def _at_control_nodes(trajectory: PhaseTrajectory) -> tuple[Array, Array]:
    """States and controls (M, m, .) at every element's control nodes."""
    basis = lagrange_matrix(trajectory.nodes, trajectory.control_nodes)
    return basis @ trajectory.states, trajectory.controls


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
    high = np.abs(np.linalg.solve(basis, values[element]) / _ranges(values)).max(axis=1)[2:]
    decay = np.polyfit(np.arange(len(high)), np.log(high + NEGLIGIBLE), 1)[0]
    return bool(np.exp(decay) < DECAY or high.max() < 10 * NEGLIGIBLE)
