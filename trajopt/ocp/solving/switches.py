"""Where a solution is not smooth: jumps, kinks and switches within an element.

No answer depends on rounding or on digits that a solver leaves open, because these differ between
processors. Every quantity has its own scale, and values that are tiny beside it count as zero.
"""

from __future__ import annotations

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.pose.phase import Phase
from trajopt.ocp.transcribe.packing import evaluated
from trajopt.ocp.transcribe.schemes.polynomials import full_differentiation_matrix, lagrange_matrix
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: Breaks of several controls that differ by less (relative) are equally large.
WORSE = 1e-2

#: If Legendre coefficients fall by a factor closer to 1 than this per degree, they are not smooth.
DECAY = 0.5

#: Legendre coefficients below this, relative to the range over the phase, are noise. So are powers
#: and distances of controls from their bounds, relative to 1 + their largest magnitude over the
#: phase.
NEGLIGIBLE = 1e-7

#: The least range, relative to 1 + the largest magnitude over the phase. Without it, the range of
#: a constant would be rounding.
CONSTANT = 1e-3

#: If the neighbours' controls, continued into an element, differ by less than this fraction of the
#: control's range, there is no break. A control that jumps by less does not jump.
NO_BREAK = 0.01

#: Fractions of the element. Breaks closer to an edge than the first are at the edge, where nothing
#: needs to be split. Jumps closer than the second are cut off together with a margin.
AT_EDGE, NEAR_EDGE = 0.005, 0.1

_SEARCHED = np.linspace(0.0, 1.0, 101)


def breaks(trajectory: PhaseTrajectory, element: int) -> list[float]:
    """The fraction of an element at which a control jumps or has a kink, if it does.

    The neighbours' controls are continued straight on into the element. (At an end of the phase,
    its own control takes the missing neighbour's place.) If they meet inside, there is a kink.
    If they meet at an edge, there is no break inside. If they do not meet, the control jumps from
    one to the other, at the place that leaves the element's mean control as it is. A jump near an
    edge is moved inwards, so that the larger piece surely has none. Of several controls the one
    with the largest break counts, or the first of those that tie. Controls that are linear on every
    element have kinks at all edges, and nothing tells where others are.
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


def is_smooth(trajectory: PhaseTrajectory, element: int) -> bool:
    """Whether the Legendre coefficients of an element's states and controls fall fast enough."""
    return _falls(trajectory.nodes, trajectory.states, element) and _falls(
        trajectory.control_nodes, trajectory.controls, element
    )


def _scale(values: Array) -> Array:
    """1 + the largest magnitude over a phase of values (M, n, m), shape (m,)."""
    return np.asarray(1.0 + np.abs(values).max(axis=(0, 1)))


def _ranges(values: Array) -> Array:
    """Ranges over a phase of values (M, n, m), shape (m,), none below `CONSTANT`."""
    return np.maximum(np.ptp(values, axis=(0, 1)), CONSTANT * _scale(values))


def _passes(values: Array, noise: float) -> list[float]:
    """Where values at `_SEARCHED` pass from clearly positive to clearly negative, or back.

    Where several values in between are noise, it is their middle.
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


def _falls(nodes: Array, values: Array, element: int) -> bool:
    """Whether the coefficients of the polynomials through values (M, n, m) fall fast enough.

    Coefficients that are negligible for the phase count as zero.
    """
    n = len(nodes)
    if n < 4 or not values.shape[-1]:
        return True
    basis = np.polynomial.legendre.legvander(2 * nodes - 1, n - 1)
    high = np.abs(np.linalg.solve(basis, values[element]) / _ranges(values)).max(axis=1)[2:]
    decay = np.polyfit(np.arange(len(high)), np.log(high + NEGLIGIBLE), 1)[0]
    return bool(np.exp(decay) < DECAY or high.max() < 10 * NEGLIGIBLE)
