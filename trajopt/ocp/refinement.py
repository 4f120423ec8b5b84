"""hp mesh refinement: higher degrees where the solution is smooth, more elements where it is not.

After Patterson, Hager and Rao, A ph mesh refinement method for optimal control, Optim. Control
Appl. Methods 36 (2015), with splits at the control's own switches.

No decision depends on rounding or on digits that a solver leaves open, because these differ between
processors. Thresholds are therefore moved off zero, off ties and off round numbers. Every quantity
has its own scale, and values that are tiny beside it count as zero.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from trajopt.ocp.accuracy import Quality
from trajopt.ocp.arrays import Array
from trajopt.ocp.layout import evaluated
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.ranking import least_first
from trajopt.ocp.scaling import PhaseScales
from trajopt.ocp.schemes import SCHEMES, full_differentiation_matrix, lagrange_matrix
from trajopt.ocp.trajectory import PhaseTrajectory

#: What refinement never exceeds: the degree of an element, and the elements of all phases together.
MAX_DEGREE = 12
MAX_ELEMENTS = 400

#: Elements are split only if they are clearly longer than this fraction of their phase.
SHORTEST = 1e-5

#: The same where only the Hamiltonian asks for it: a control that may switch on still shorter
#: elements exploits the discretisation.
SHORTEST_CERTIFIED = 1e-3

#: What "clearly" means, relative: equal elements differ in width by rounding, and elements of a
#: symmetrical solution differ in error, and breaks of several controls in size, by what a solver
#: leaves open.
CLEARLY, WORSE = 1e-6, 1e-2

#: Path constraints violated by more than this between nodes ask for a finer mesh. Smaller
#: violations are left to margins (`within_limits` in `solve`): where a control switches, no mesh is
#: fine enough.
COARSE = 1e-3

#: If Legendre coefficients fall by a factor closer to 1 than this per degree, they are not smooth.
DECAY = 0.5

#: Legendre coefficients below this, relative to the range over the phase, are noise. So are powers
#: and distances of controls from their bounds, relative to their scale + their largest magnitude
#: over the phase.
NEGLIGIBLE = 1e-7

#: The least range, relative to the scale + the largest magnitude over the phase. Without it, the
#: range of a constant would be rounding.
CONSTANT = 1e-3

#: If the neighbours' controls, continued into an element, differ by less than this fraction of the
#: control's range, there is no break. A control that jumps by less does not jump.
NO_BREAK = 0.01

#: Fractions of the element. Breaks closer to an edge than the first are at the edge, where nothing
#: needs to be split. Jumps closer than the second are cut off together with a margin.
AT_EDGE, NEAR_EDGE = 0.005, 0.1

_SEARCHED = np.linspace(0.0, 1.0, 101)


@dataclasses.dataclass(frozen=True)
class Tolerances:
    """What a mesh has to meet."""

    states: float = 1e-7  # largest relative error of the states within an element
    # largest error of the cost within an element, relative to its scale + |cost|
    cost: float = 1e-6
    # largest relative violation of bounds and path constraints between the nodes
    limits: float = 1e-6
    hamiltonian: float = 1e-3  # largest relative change of the Hamiltonian over an element


def refined(
    mesh: Mesh,
    problem: Problem,
    phases: Sequence[PhaseTrajectory],
    p: Array,
    scales: Sequence[PhaseScales],
    qualities: Sequence[Quality],
    wanted: Sequence[Array],
    tolerances: Tolerances,
) -> Mesh:
    """A finer mesh where a tolerance is missed; the same mesh if none is, or caps forbid it.

    An element in which the control switches (it jumps and costs too much, a power passes its floor,
    a bound is met or left) is split there. Otherwise, if states and controls are smooth, its degree
    rises by as much as the error asks for; if they are not, or the degree is at its cap, it is
    halved. Where there is no room to split all elements, the worst are split.
    """
    fractions, degrees = [], []
    room, fixed = max(MAX_ELEMENTS - mesh.elements, 0), bool(SCHEMES[mesh.scheme].degree)
    pairs = zip(problem.phases, qualities, strict=True)
    limits = [_limits(phase, quality, tolerances.limits) for phase, quality in pairs]
    misses = [_misses(*each, tolerances) for each in zip(qualities, limits, strict=True)]
    everywhere = [(i, e) for i, each in enumerate(misses) for e in range(len(each))]
    worst = set(least_first(everywhere, lambda at: -misses[at[0]][at[1]], WORSE)[:room])
    for i, (phase, trajectory, units, quality) in enumerate(
        zip(problem.phases, phases, scales, qualities, strict=True)
    ):
        edges, orders = [0.0], []
        for e, degree in enumerate(mesh.degrees[i]):
            left, right = mesh.fractions[i][e : e + 2]
            excess = max(
                quality.state_error[e] / tolerances.states, quality.cost_error[e] / tolerances.cost
            )
            gap = quality.cost_gap[e] / tolerances.cost
            wasteful = gap > 1.0
            jumps, inside = breaks(trajectory, e, units) if wasteful else [], []
            if wasteful and not jumps:
                at = np.sort(wanted[i][wanted[i][:, 0] == e, 1])
                apart = np.diff(at, prepend=0.0) > AT_EDGE
                jumps = at[apart & (at < 1 - AT_EDGE)].tolist()
            if not jumps:
                excess = max(excess, gap)
            if jumps or max(excess, limits[i][e]) > 1.0:
                digits = math.log10(np.clip(excess, 1.0, 1e99))
                raised = degree + max(1, math.ceil(digits - CLEARLY))
                switches = switch_points(phase, trajectory, e, p, units)
                smooth = not fixed and is_smooth(trajectory, e, units) and not switches
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


def certified(mesh: Mesh, hamiltonian: Sequence[Array], scales: Array, tolerance: float) -> Mesh:
    """Halve the elements over which the Hamiltonian changes: an optimal control switches in there.

    It is given at both ends of every element, (M, 2) per phase; the tolerance of its change is
    relative to its scale (phases,) + its median's magnitude.
    """
    fractions, degrees = [], []
    each = zip(mesh.fractions, mesh.degrees, hamiltonian, scales, strict=True)
    for edges, orders, values, scale in each:
        drift = np.abs(values[:, 1] - values[:, 0]) / (scale + abs(np.median(values)))
        split = (drift > tolerance) & _longer(np.diff(edges), SHORTEST_CERTIFIED)
        middles = 0.5 * (np.array(edges[1:]) + np.array(edges[:-1]))
        fractions.append(tuple(sorted([*edges, *middles[split].tolist()])))
        degrees.append(tuple(np.repeat(orders, 1 + split).tolist()))
    return dataclasses.replace(mesh, fractions=tuple(fractions), degrees=tuple(degrees))


def _longer(width: Any, than: float) -> Any:
    return width > (1 + CLEARLY) * than


def _misses(quality: Quality, limits: Array, tolerances: Tolerances) -> Array:
    """The largest of all errors of every element, relative to its tolerance, shape (M,)."""
    cost = np.maximum(quality.cost_error, quality.cost_gap) / tolerances.cost
    return np.max([quality.state_error / tolerances.states, cost, limits], axis=0)


def _limits(phase: Phase, quality: Quality, tolerance: float) -> Array:
    """Violations of limits, relative to what asks for a finer mesh, shape (M,)."""
    asked: Any = COARSE
    if phase.path is not None:  # an equation has no room for margins
        asked = np.where(phase.path.lower == phase.path.upper, tolerance, COARSE)
    path = (quality.path_violation / asked).max(axis=1)
    return np.asarray(np.maximum(quality.limit_violation / tolerance, path))


# -- jumps, kinks and switches within an element ------------------------------------------------


def breaks(trajectory: PhaseTrajectory, element: int, scales: PhaseScales) -> list[float]:
    """The fraction of an element at which a control jumps or has a kink, if it does.

    The neighbours' controls are continued straight on into the element. (At an end of the phase,
    its own control takes the missing neighbour's place.) If they meet inside, there is a kink.
    If they meet at an edge, there is no break inside. If they do not meet, the control jumps from
    one to the other, at the place that leaves the element's mean control as it is. A jump near an
    edge is moved inwards, so that the larger piece surely has none. Of several controls the one
    with the largest break counts, or the first of those that tie. Controls that are linear on every
    element have kinks at all edges, and where others are is not known.
    """
    u, h = trajectory.controls, trajectory.element_durations
    if not u.shape[-1] or len(trajectory.control_nodes) < 3:
        return []
    slope = full_differentiation_matrix(tuple(trajectory.control_nodes))
    last, first = max(element - 1, 0), min(element + 1, len(u) - 1)
    i, j = (-1 if last < element else 0), (0 if first > element else -1)
    before, rise = u[last, i], h[element] / h[last] * (slope[i] @ u[last])
    after, fall = u[first, j], h[element] / h[first] * (slope[j] @ u[first])
    ranges = _ranges(u, scales.controls)
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


def switch_points(
    phase: Phase, trajectory: PhaseTrajectory, element: int, p: Array, scales: PhaseScales
) -> list[float]:
    """Fractions of an element at which a power passes its floor, or a control meets its bound."""
    u = lagrange_matrix(trajectory.control_nodes, _SEARCHED) @ trajectory.controls[element]
    x = lagrange_matrix(trajectory.nodes, _SEARCHED) @ trajectory.states[element]
    signals, noise = [], []
    if phase.powers is not None and np.isfinite(phase.floor):
        basis = lagrange_matrix(trajectory.nodes, trajectory.control_nodes)
        at_nodes = basis @ trajectory.states, trajectory.controls
        everywhere = evaluated(phase.powers, *at_nodes, p)
        signals.append(evaluated(phase.powers, x, u, p) - phase.floor)
        noise.append(NEGLIGIBLE * _scale(everywhere, scales.powers))
    lower, upper = phase.control_bounds()
    near = 1e-3 * _ranges(trajectory.controls, scales.controls)
    signals += [u - lower - near, upper - near - u]
    noise += [NEGLIGIBLE * _scale(trajectory.controls, scales.controls)] * 2
    switches: set[float] = set()
    for values, least in zip(np.concatenate(signals, axis=1).T, np.concatenate(noise), strict=True):
        for s in _passes(values, least) if np.isfinite(values).all() else []:
            if 0.05 < s < 0.95 and all(abs(s - other) > 0.05 for other in switches):
                switches.add(s)
    return sorted(switches)


def is_smooth(trajectory: PhaseTrajectory, element: int, scales: PhaseScales) -> bool:
    """Whether the Legendre coefficients of an element's states and controls fall fast enough."""
    t = trajectory
    states, controls = _ranges(t.states, scales.states), _ranges(t.controls, scales.controls)
    return _falls(t.nodes, t.states[element] / states) and _falls(
        t.control_nodes, t.controls[element] / controls
    )


def _scale(values: Array, units: Array) -> Array:
    """The scale + the largest magnitude over a phase of values (M, n, m), shape (m,)."""
    return np.asarray(units + np.abs(values).max(axis=(0, 1)))


def _ranges(values: Array, units: Array) -> Array:
    """Ranges over a phase of values (M, n, m), shape (m,), none below `CONSTANT`."""
    return np.maximum(np.ptp(values, axis=(0, 1)), CONSTANT * _scale(values, units))


def _passes(values: Array, noise: float) -> list[float]:
    """Where values at `_SEARCHED` pass from clearly positive to clearly negative, or back.

    Where several values in between are noise, it is their middle.
    """
    clear = np.flatnonzero(np.abs(values) > noise)
    passing = np.flatnonzero(np.diff(np.sign(values[clear])))
    places = []
    for k, m in zip(clear[passing], clear[passing + 1], strict=True):
        between = _SEARCHED[k + 1 : m]
        zero = _SEARCHED[k] + values[k] / (values[k] - values[m]) * (_SEARCHED[m] - _SEARCHED[k])
        places.append(float(between.mean() if len(between) else zero))
    return places


def _falls(nodes: Array, values: Array) -> bool:
    """Whether the coefficients of the polynomials through values (n, m) fall fast enough.

    The values are relative to their ranges over the phase; negligible ones count as zero.
    """
    n = len(nodes)
    if n < 4 or not values.shape[-1]:
        return True
    basis = np.polynomial.legendre.legvander(2 * nodes - 1, n - 1)
    high = np.abs(np.linalg.solve(basis, values)).max(axis=1)[2:]
    decay = np.polyfit(np.arange(len(high)), np.log(high + NEGLIGIBLE), 1)[0]
    return bool(np.exp(decay) < DECAY or high.max() < 10 * NEGLIGIBLE)
