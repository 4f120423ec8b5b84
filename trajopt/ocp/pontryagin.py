"""Pontryagin's principle along a solution: what other controls would save, and where.

The costate within an element follows from its values at the edges. Where a constraint on the state
is active, these do not fit together: the costate changes by the constraint's multiplier, and when
it does so within the element is not known. It is chosen such that the control is as good as it can
be: the estimate is then no larger than with the multiplier's true place.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import Constraint
from trajopt.ocp.layout import evaluated
from trajopt.ocp.problem import Phase
from trajopt.ocp.scaling import PhaseScales
from trajopt.ocp.schemes import (
    control_nodes,
    full_differentiation_matrix,
    interpolatory_weights,
    lagrange_matrix,
)
from trajopt.ocp.trajectory import PhaseTrajectory

#: Places on an element at which other controls are tried: Chebyshev points.
PLACES = control_nodes(12)

#: On values at `PLACES`: derivatives, and the integral.
SLOPE, WEIGHTS = full_differentiation_matrix(tuple(PLACES)), interpolatory_weights(PLACES)

#: Controls are tried at all corners of the bounds of so many, and as on so many other elements.
CORNERS, OTHERS = 5, 12

#: A control may violate path constraints by so much, relative, and a Hamiltonian is convex if its
#: curvatures differ by less than the inverse of that.
ROUNDING = 1e-9

#: A control switches where what another would save passes this fraction of its largest value.
NOTHING = 1e-3

#: How often the interval in which the best share lies is shortened by a third.
THIRDS = 42


def gaps(
    view: View, inside: Inside, scales: PhaseScales, limited: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """What each element's control costs too much, and where it should switch.

    Args:
        view: the phase.
        inside: `View.inside` of it.
        scales: of the phase.
        limited: elements (M,) in which a constraint on the state may be active.

    Returns:
        The costs (M,), and (element, fraction of it) of the missing switches, shape (k, 2).
    """
    share = np.tile(PLACES, (len(limited), 1))
    if limited.any():
        share[limited] = _shares(view, Inside(*(each[limited] for each in inside)), scales)
    near, far = _savings(view, inside, inside.costates(share), scales)
    return view.trajectory.element_durations * (near @ WEIGHTS), _switches(far)


def _savings(
    view: View, inside: Inside, costates: Array, scales: PhaseScales
) -> tuple[Array, Array]:
    """By how much another control would lower the Hamiltonian, at `PLACES`, (M, n).

    The second are the same where that control is none of Newton's: it is far away.
    """
    x, u, path = inside.states, inside.controls, view.phase.path

    def value(control: Array) -> Array:
        values = view.hamiltonian(x, control, costates)
        if path is not None and control is not u:
            values = np.where(_allowed(path, x, control, view.p, scales), values, np.inf)
        return values

    now, near = value(u), value(view.newton(x, u, costates, scales.controls))
    far = np.min([now, *map(value, _tried(view, u))], axis=0)
    savings = np.nan_to_num(now - np.fmin(near, far), nan=0.0, posinf=0.0)
    return savings, np.where(far < near, savings, 0.0)


def _shares(view: View, inside: Inside, scales: PhaseScales) -> Array:
    """The share of the multipliers before each place at which other controls save least, (M, n).

    Multipliers have one sign, so that the share never falls. What a control saves is linear in the
    share, and the most that any saves is convex. So the best shares that never fall are among the
    best at single places (as in isotonic regression); dynamic programming chooses.
    """
    x, u, path = inside.states, inside.controls, view.phase.path
    M, n = x.shape[:2]

    def saved(control: Array, costates: Array) -> Array:
        saved = finite(view.hamiltonian(x, u, costates) - view.hamiltonian(x, control, costates))
        allowed = path is None or _allowed(path, x, control, view.p, scales)
        return np.where(allowed, saved, 0.0)

    tried = list(_tried(view, u))
    zero, one = (
        np.array([np.zeros((M, n)), *(saved(control, costates) for control in tried)])
        for costates in (inside.from_left, inside.from_right)
    )

    def most(share: Array) -> Array:
        costates = inside.costates(share)
        newton = saved(view.newton(x, u, costates, scales.controls), costates)
        return np.maximum(newton, (zero + share * (one - zero)).max(axis=0))

    best, high = np.zeros((M, n)), np.ones((M, n))
    for _ in range(THIRDS):
        third = (high - best) / 3
        left = most(best + third) <= most(high - third)
        best, high = np.where(left, best, best + third), np.where(left, high - third, high)
    levels = np.sort(np.hstack([best, np.zeros((M, 1)), np.ones((M, 1))]), axis=1)
    costs = WEIGHTS[:, None] * np.stack([most(level[:, None]) for level in levels.T], axis=-1)
    for k in range(1, n):
        costs[:, k] += np.minimum.accumulate(costs[:, k - 1], axis=1)
    chosen, share = np.full(M, levels.shape[1]), np.empty((M, n))
    for k in reversed(range(n)):
        within = np.arange(levels.shape[1]) <= chosen[:, None]
        chosen = np.where(within, costs[:, k], np.inf).argmin(axis=1)
        share[:, k] = levels[np.arange(M), chosen]
    return share


def _allowed(path: Constraint, x: Array, u: Array, p: Array, scales: PhaseScales) -> Array:
    excess = path.violation(evaluated(path.function, x, u, p)) / scales.path
    return np.asarray((excess < ROUNDING).all(axis=-1))


def _tried(view: View, u: Array) -> Iterator[Array]:
    """Controls that may be better than u: at their bounds, and as elsewhere in the phase."""
    if not u.shape[-1]:
        return
    lower, upper = view.phase.control_bounds()
    bounded = np.flatnonzero(np.isfinite(lower) & np.isfinite(upper))[:CORNERS]
    for corner in itertools.product((0, 1), repeat=len(bounded)):
        other = u.copy()
        other[..., bounded] = np.where(corner, upper[bounded], lower[bounded])
        yield other
    means = view.trajectory.controls.mean(axis=1)
    chosen = np.unique(np.linspace(0, len(means) - 1, OTHERS).astype(int))
    for mean in means[chosen]:
        yield np.broadcast_to(mean, u.shape)


def _switches(savings: Array) -> Array:
    """(element, fraction) where savings (M, n) at `PLACES` begin or end, shape (k, 2).

    Next to a switch they are proportional to the distance from it.
    """
    found = []
    for e, values in enumerate(savings):
        saves = values > NOTHING * values.max()
        for k in np.flatnonzero(saves[1:] != saves[:-1]):
            i, j = (k + 1, k + 2) if saves[k + 1] else (k, k - 1)  # the first that save
            if not 0 <= j < len(values) or values[j] <= values[i]:
                found.append((e, 0.5 * (PLACES[k] + PLACES[k + 1])))
                continue
            s = PLACES[i] - values[i] * (PLACES[j] - PLACES[i]) / (values[j] - values[i])
            found.append((e, float(np.clip(s, PLACES[k], PLACES[k + 1]))))
    return np.array(found).reshape(-1, 2)


# -- a phase and its costates --------------------------------------------------------------------


class Inside(NamedTuple):
    """A phase at `PLACES` of every element, (M, n, .); costates as they follow from either edge."""

    states: Array
    controls: Array
    from_left: Array
    from_right: Array

    def costates(self, share: Array | float = PLACES) -> Array:
        """Costates if such a share (M, n) of what they differ by has acted before each place."""
        s = np.broadcast_to(share, self.states.shape[:2])[..., None]
        return (1 - s) * self.from_left + s * self.from_right


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """A phase with its costates (M + 1, nx) and the multipliers (m,) of its bounded integrals."""

    phase: Phase
    trajectory: PhaseTrajectory
    costates: Array
    p: Array
    integral_multipliers: Array

    def at_ends(self) -> tuple[Array, Array, Array]:
        """States, controls and costates at both ends of every element, (M, 2, .) each."""
        t, costates = self.trajectory, np.stack([self.costates[:-1], self.costates[1:]], axis=1)
        return t.states[:, [0, -1]], t.controls[:, [0, -1]], costates

    def inside(self) -> Inside:
        """States, controls and costates at `PLACES` of every element.

        The costates follow costate' = -dH/dx from both edges of the element. These differ where a
        constraint on the state is active, of which the multiplier's place is not known.
        """
        t, n = self.trajectory, len(PLACES)
        x = lagrange_matrix(t.nodes, PLACES) @ t.states
        u = lagrange_matrix(t.control_nodes, PLACES) @ t.controls
        M, _, nx = x.shape
        still = finite(self._call("slope", x, u, np.zeros_like(x)))
        basis = np.eye(nx)
        gains = np.stack(
            [finite(self._call("slope", x, u, np.zeros_like(x) + row)) - still for row in basis],
            axis=-1,
        )  # (M, n, nx, nx): of the slope by the costate
        h = t.element_durations[:, None, None, None]
        matrix = np.zeros((M, n, nx, n, nx))
        matrix += SLOPE[:, None, :, None] * basis[:, None, :]
        places = np.arange(n)
        matrix[:, places, :, places] += np.moveaxis(h * gains, 1, 0)
        sides: list[Array] = []
        for edge, given in ((0, self.costates[:-1]), (-1, self.costates[1:])):
            system, right = matrix.copy(), -h[..., 0] * still
            system[:, edge], right[:, edge] = 0.0, given
            system[:, edge, range(nx), edge, range(nx)] = 1.0
            flat = system.reshape(M, n * nx, n * nx), right.reshape(M, n * nx, 1)
            sides.append(np.asarray(np.linalg.solve(*flat)).reshape(M, n, nx))
        return Inside(x, u, *sides)

    def hamiltonian(self, x: Array, u: Array, costates: Array) -> Array:
        """The Hamiltonian at states, controls and costates (..., .)."""
        return self._call("value", x, u, costates)[..., 0]

    def switching(self, x: Array, u: Array, costates: Array) -> Array:
        """The Hamiltonian's derivatives with respect to the controls, (..., nu)."""
        return self._call("model", x, u, costates)[..., : u.shape[-1]]

    def newton(self, x: Array, u: Array, costates: Array, units: Array) -> Array:
        """The controls within bounds at which the Hamiltonian's model is least, if it is convex."""
        nu = u.shape[-1]
        if not nu:
            return u
        model = self._call("model", x, u, costates)
        gradient = units * model[..., :nu]
        curvature = finite(units[:, None] * units * model[..., nu:].reshape(*u.shape, nu))
        curvatures = np.linalg.eigvalsh(curvature)
        convex = curvatures[..., 0] > ROUNDING * np.abs(curvatures).max(axis=-1)
        safe = np.where(convex[..., None, None], curvature, np.eye(nu))
        step = -units * np.linalg.solve(safe, gradient[..., None])[..., 0]
        newton = u + np.where(convex[..., None], step, 0.0)
        return np.clip(newton, *self.phase.control_bounds())

    def _call(self, name: str, x: Array, u: Array, costates: Array) -> Array:
        phase = self.phase
        integral = phase.integral and phase.integral.function
        floor = [phase.floor if phase.powers else 0.0]
        constants = np.concatenate([self.p, self.integral_multipliers, floor])
        joined = np.concatenate([u, costates], axis=-1)
        functions = _hamiltonian(phase.flow, phase.cost, phase.powers, integral)
        return evaluated(functions[name], x, joined, constants)


def finite(values: Array) -> Array:
    """The values, with 0 in place of what is not finite."""
    return np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)


@lru_cache(maxsize=64)
def _hamiltonian(
    flow: ca.Function, cost: Any, powers: Any, integral: Any
) -> dict[str, ca.Function]:
    """The Hamiltonian of (x, (u, costate), constants): value, slope in x, model in u.

    The constants are p, the multipliers of the integrals, and the floor.
    """
    x, u, p = flow.sx_in()
    costate, floor = ca.SX.sym("costate", x.numel()), ca.SX.sym("floor")
    multipliers = ca.SX.sym("multipliers", integral.size1_out(0) if integral else 0)
    value = ca.dot(costate, flow(x, u, p))
    if cost:
        value += cost(x, u, p)
    if powers:
        value += ca.sum1(ca.fmax(powers(x, u, p), floor))
    if integral:
        value += ca.dot(multipliers, integral(x, u, p))
    hessian, gradient = ca.hessian(value, u)
    outputs = {
        "value": value,
        "slope": ca.gradient(value, x),
        "model": ca.vertcat(gradient, ca.vec(hessian)),
    }
    arguments = x, ca.vertcat(u, costate), ca.vertcat(p, multipliers, floor)
    return {name: ca.Function(name, arguments, [ca.densify(o)]) for name, o in outputs.items()}
