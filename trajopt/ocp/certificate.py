"""Costates and Hamiltonian of a solution: how close its controls are to optimal.

The costate at an element's edge is the derivative of the remaining cost with respect to the state
there; it is computed from the next element's Lagrangian. At an optimum the Hamiltonian, running
cost + costate . flow, is constant along every phase, because nothing depends on time explicitly. It
equals the price of the phase's duration: the derivative of the phase's least cost with respect to
it. (A bounded integral counts as a running cost, priced at its multiplier.) At every time, the
optimal control minimises it (Pontryagin). What another control would save, integrated over time, is
about what a solution costs too much: where a control switches too late, or where a polynomial
follows a jump.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import trapezoid

from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import Constraint
from trajopt.ocp.equations import path_nodes
from trajopt.ocp.layout import evaluated
from trajopt.ocp.problem import Phase
from trajopt.ocp.scaling import PhaseScales, Scales, jacobian
from trajopt.ocp.schemes import control_nodes, full_differentiation_matrix, lagrange_matrix
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.ocp.transcription import Result, Transcription

#: Places on an element at which other controls are tried: Chebyshev points.
PLACES = control_nodes(12)

#: Controls are tried at all corners of the bounds of so many, and as on so many other elements.
CORNERS, OTHERS = 5, 12

#: A control may violate path constraints by so much, relative, and a Hamiltonian is convex if its
#: curvatures differ by less than the inverse of that.
ROUNDING = 1e-9

#: A constraint on the state has a price if it exceeds this, relative to the cost's scale.
PRICED = 1e-6

#: A control switches where what another would save passes this fraction of its largest value.
NOTHING = 1e-3


@dataclasses.dataclass(frozen=True)
class Certificate:
    """First-order optimality, phase by phase.

    Attributes:
        costates: at the elements' edges, shape (M + 1, nx) each; cost per unit of the state.
        hamiltonian: at both ends of every element, shape (M, 2) each.
        duration_price: the derivative of the least cost with respect to each phase's duration,
            shape (phases,).
        cost_gaps: about what each element's control costs too much, shape (M,) each; where a
            constraint on the state is active, the Hamiltonian's variation times the duration.
        switches: of every phase, (element, fraction of it) where a control should switch but does
            not, shape (n, 2) each.
        prices: of every phase's bounded integrals, shape (m,) each.
        scales: of the Hamiltonian, shape (phases,): that of the cost over the duration.
    """

    costates: tuple[Array, ...]
    hamiltonian: tuple[Array, ...]
    duration_price: Array
    cost_gaps: tuple[Array, ...]
    switches: tuple[Array, ...]
    prices: tuple[Array, ...]
    scales: Array

    @property
    def suboptimality(self) -> float:
        """About what all controls cost too much, in the unit of the cost."""
        return float(sum(gaps.sum() for gaps in self.cost_gaps))

    @property
    def hamiltonian_spread(self) -> float:
        """Largest deviation from its mean over a phase, relative to scale + largest magnitude."""
        pairs = zip(self.hamiltonian, self.scales, strict=True)
        with np.errstate(invalid="ignore"):  # a flow that is not finite
            spreads = [np.abs(h - h.mean()).max() / (s + np.abs(h).max()) for h, s in pairs]
        return float(np.nan_to_num(max(spreads), nan=np.inf))

    @property
    def transversality_error(self) -> float:
        """Largest gap between the mean Hamiltonian and the price of duration, likewise relative."""
        each = zip(self.hamiltonian, self.duration_price, self.scales, strict=True)
        return float(max(abs(h.mean() - price) / (s + abs(price)) for h, price, s in each))


@np.errstate(invalid="ignore")  # functions need not be finite everywhere
def certificate(transcription: Transcription, result: Result, scales: Scales) -> Certificate:
    """Costates and Hamiltonian of a solution from its multipliers."""
    problem = transcription.problem
    means = [np.zeros(len(t.edges) - 1) for t in result.phases]
    costates = [np.zeros((len(t.edges), t.states.shape[-1])) for t in result.phases]
    for each in transcription.equations.element_blocks:
        index, group, block = each.phase, each.group, each.block
        v, d = block.function.sx_in()
        outputs, cost = block.function(v, d)
        mu = ca.SX.sym("mu", outputs.numel())
        gradient = ca.Function("g", [v, d, mu], [ca.gradient(cost + ca.dot(mu, outputs), v)])
        values = np.asarray(
            gradient.map(block.count)(
                result.unknowns[block.variables], block.data, result.multipliers[block.rows]
            )
        )
        nx, n = len(problem.phases[index].states), len(group.scheme.nodes)
        costates[index][group.elements] = values[:nx].T
        if group.elements[-1] == len(costates[index]) - 2:
            right = nx * (n - 1)
            costates[index][-1] = -values[right : right + nx, -1]
        means[index][group.elements] = values[-1 - len(result.parameters)] / block.data[0]
    prices = [np.zeros(0) for _ in problem.phases]
    for rows, multipliers in transcription.multipliers_of(result):
        if rows.kind == "integral":
            prices[rows.phase] = multipliers
    views = [
        View(phase, trajectory, costates[i], result.parameters, prices[i])
        for i, (phase, trajectory) in enumerate(zip(problem.phases, result.phases, strict=True))
    ]
    hamiltonians = [view.hamiltonian(*view.at_ends()) for view in views]
    savings = []
    for i, view in enumerate(views):
        near, far = _savings(view, scales.phases[i])
        priced = _priced(transcription, result, i, scales)[:, None]
        spread = np.ptp(np.column_stack([hamiltonians[i], means[i]]), axis=1)[:, None]
        savings.append((np.where(priced, spread, near), np.where(priced, 0.0, far)))
    widths = [t.element_durations / t.duration for t in result.phases]
    price = np.array([mean @ width for mean, width in zip(means, widths, strict=True)])
    return Certificate(
        costates=tuple(costates),
        hamiltonian=tuple(hamiltonians),
        duration_price=price,
        cost_gaps=tuple(
            trapezoid(near, PLACES) * view.trajectory.element_durations
            for (near, _), view in zip(savings, views, strict=True)
        ),
        switches=tuple(_switches(far) for _, far in savings),
        prices=tuple(prices),
        scales=scales.cost / np.array([each.duration for each in scales.phases]),
    )


def _priced(transcription: Transcription, result: Result, index: int, scales: Scales) -> Array:
    """Of which elements of a phase a constraint on the state has a price, shape (M,).

    The costate jumps by such prices, and where in the element is not known.
    """
    phase, path = transcription.problem.phases[index], result.phases[index]
    layout, nx, units = transcription.layout, len(phase.states), scales.phases[index].states
    bounds = np.abs(result.bound_multipliers)
    edges = (bounds[layout.indices(index, "edges", 0)].T * units)[1:-1].max(axis=1)
    prices = np.maximum(np.append(0.0, edges), np.append(edges, 0.0))
    m = len(phase.path.names) if phase.path is not None else 0
    if phase.path is not None:
        u = lagrange_matrix(path.control_nodes, path.nodes) @ path.controls
        every = evaluated(jacobian(phase.path.function), path.states, u, result.parameters)
        every = np.abs(every).max(axis=1).reshape(len(every), -1, m)
        pure = every[:, nx : nx + u.shape[-1]].max(axis=(0, 1), initial=0.0) == 0.0  # not of u
        slopes = every[:, :nx] * pure
    for each in transcription.equations.element_blocks:
        if each.phase != index:
            continue
        scheme, chosen = each.group.scheme, each.group.elements
        interior = layout.indices(index, "interior", each.group.degree)
        within = bounds[interior] * np.tile(units, len(interior) // nx)[:, None]
        prices[chosen] = np.maximum(prices[chosen], within.max(axis=0, initial=0.0))
        if m:
            first = nx * len(scheme.D)
            rows = each.block.rows[first : first + m * len(path_nodes(scheme))]
            sums = np.abs(result.multipliers[rows]).reshape(-1, m, len(chosen)).sum(axis=0)
            jumps = np.einsum("exm,me->ex", slopes[chosen], sums) * units
            prices[chosen] = np.maximum(prices[chosen], jumps.max(axis=1))
    return prices > PRICED * scales.cost


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """A phase with its costates (M + 1, nx) and the prices (m,) of its bounded integrals."""

    phase: Phase
    trajectory: PhaseTrajectory
    costates: Array
    p: Array
    prices: Array

    def at_ends(self) -> tuple[Array, Array, Array]:
        """States, controls and costates at both ends of every element, (M, 2, .) each."""
        t, costates = self.trajectory, np.stack([self.costates[:-1], self.costates[1:]], axis=1)
        return t.states[:, [0, -1]], t.controls[:, [0, -1]], costates

    def inside(self) -> tuple[Array, Array, Array]:
        """The same at `PLACES` of every element.

        The costates follow costate' = -dH/dx backwards from each element's right edge. What then
        misses the left edge, the price of a constraint on the state, is spread over the element.
        """
        t, n = self.trajectory, len(PLACES)
        x = lagrange_matrix(t.nodes, PLACES) @ t.states
        u = lagrange_matrix(t.control_nodes, PLACES) @ t.controls
        M, _, nx = x.shape
        still = _finite(self._call("slope", x, u, np.zeros_like(x)))
        basis = np.eye(nx)
        gains = np.stack(
            [_finite(self._call("slope", x, u, np.zeros_like(x) + row)) - still for row in basis],
            axis=-1,
        )  # (M, n, nx, nx): of the slope by the costate
        h = t.element_durations[:, None, None, None]
        matrix = np.zeros((M, n, nx, n, nx))
        slope = full_differentiation_matrix(tuple(PLACES))
        matrix += slope[:, None, :, None] * basis[:, None, :]
        places = np.arange(n)
        matrix[:, places, :, places] += np.moveaxis(h * gains, 1, 0)
        right = -h[..., 0] * still
        matrix[:, -1], right[:, -1] = 0.0, self.costates[1:]
        matrix[:, -1, range(nx), -1, range(nx)] = 1.0
        solved = np.linalg.solve(
            matrix.reshape(M, n * nx, n * nx), right.reshape(M, n * nx, 1)
        ).reshape(M, n, nx)
        missed = self.costates[:-1] - solved[:, 0]
        return x, u, solved + (1 - PLACES)[:, None] * missed[:, None]

    def hamiltonian(self, x: Array, u: Array, costates: Array) -> Array:
        """The Hamiltonian at states, controls and costates (..., .)."""
        return self._call("value", x, u, costates)[..., 0]

    def switching(self, x: Array, u: Array, costates: Array) -> Array:
        """The Hamiltonian's derivatives with respect to the controls, (..., nu)."""
        return self._call("model", x, u, costates)[..., : u.shape[-1]]

    def newton(self, x: Array, u: Array, costates: Array, units: Array) -> Array:
        """The controls at which the Hamiltonian's quadratic model is least, where it is convex."""
        nu = u.shape[-1]
        if not nu:
            return u
        model = self._call("model", x, u, costates)
        gradient = units * model[..., :nu]
        curvature = _finite(units[:, None] * units * model[..., nu:].reshape(*u.shape, nu))
        curvatures = np.linalg.eigvalsh(curvature)
        convex = curvatures[..., 0] > ROUNDING * np.abs(curvatures).max(axis=-1)
        safe = np.where(convex[..., None, None], curvature, np.eye(nu))
        step = -units * np.linalg.solve(safe, gradient[..., None])[..., 0]
        return np.asarray(u + np.where(convex[..., None], step, 0.0))

    def _call(self, name: str, x: Array, u: Array, costates: Array) -> Array:
        phase = self.phase
        integral = phase.integral and phase.integral.function
        constants = np.concatenate([self.p, self.prices, [phase.floor if phase.powers else 0.0]])
        joined = np.concatenate([u, costates], axis=-1)
        functions = _hamiltonian(phase.flow, phase.cost, phase.powers, integral)
        return evaluated(functions[name], x, joined, constants)


def _finite(values: Array) -> Array:
    return np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)


@lru_cache(maxsize=64)
def _hamiltonian(
    flow: ca.Function, cost: Any, powers: Any, integral: Any
) -> dict[str, ca.Function]:
    """The Hamiltonian of (x, (u, costate), (p, prices, floor)): value, slope in x, model in u."""
    x, u, p = flow.sx_in()
    costate, floor = ca.SX.sym("costate", x.numel()), ca.SX.sym("floor")
    prices = ca.SX.sym("prices", integral.size1_out(0) if integral else 0)
    value = ca.dot(costate, flow(x, u, p))
    if cost:
        value += cost(x, u, p)
    if powers:
        value += ca.sum1(ca.fmax(powers(x, u, p), floor))
    if integral:
        value += ca.dot(prices, integral(x, u, p))
    hessian, gradient = ca.hessian(value, u)
    outputs = {
        "value": value,
        "slope": ca.gradient(value, x),
        "model": ca.vertcat(gradient, ca.vec(hessian)),
    }
    arguments = x, ca.vertcat(u, costate), ca.vertcat(p, prices, floor)
    return {name: ca.Function(name, arguments, [ca.densify(o)]) for name, o in outputs.items()}


def _savings(view: View, scales: PhaseScales) -> tuple[Array, Array]:
    """By how much another control would lower the Hamiltonian, at `PLACES`, (M, n).

    The second are the same where that control is none of Newton's: it is far away.
    """
    x, u, costates = view.inside()
    path = view.phase.path

    def value(control: Array) -> Array:
        values = view.hamiltonian(x, control, costates)
        if path is not None and control is not u:
            values = np.where(_allowed(path, x, control, view.p, scales), values, np.inf)
        return values

    newton = view.newton(x, u, costates, scales.controls)
    now, near = value(u), value(np.clip(newton, *view.phase.control_bounds()))
    far = np.min([now, *map(value, _tried(view, u))], axis=0)
    savings = np.nan_to_num(now - np.fmin(near, far), nan=0.0, posinf=0.0)
    return savings, np.where(far < near, savings, 0.0)


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
