"""Costates and Hamiltonian of a solution: how close its controls are to optimal.

The costate at an element's edge is the derivative of the remaining cost with respect to the state
there; it is computed from the next element's Lagrangian. At an optimum the Hamiltonian, running
cost + costate . flow, is constant along every phase, because nothing depends on time explicitly. It
equals the multiplier of the phase's duration: the derivative of the phase's least cost with respect
to it. (A bounded integral counts as a running cost, times its multiplier.) At every time, the
optimal control minimises it (Pontryagin).

To first order, three integrals are how far a solution's cost is from the least: what another
control would save, where a control switches too late, or where a polynomial follows a jump; the
residual of the differential equations, times the costate; and by how much active limits are missed,
times their multipliers.
"""

from __future__ import annotations

import dataclasses

import casadi as ca
import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import beyond
from trajopt.ocp.equations import path_nodes
from trajopt.ocp.layout import evaluated, running_cost
from trajopt.ocp.pontryagin import SLOPE, WEIGHTS, Inside, View, finite, gaps
from trajopt.ocp.problem import Phase
from trajopt.ocp.scaling import PhaseScales, Scales
from trajopt.ocp.schemes import control_nodes, lagrange_matrix
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.ocp.transcription import Result, Transcription

#: Points of the dense grid on an element, less one, and the grid itself: Chebyshev points. A
#: polynomial of degree 12 is nowhere more than 1.42 times as large as its largest value at 25 of
#: them (Ehlich and Zeller, 1964). Evenly spread points miss what happens close to the edges.
SAMPLES = 24
GRID = control_nodes(SAMPLES)

#: Limits with multipliers below this, relative to the scales of cost and limit, are not active.
ACTIVE = 1e-6


@dataclasses.dataclass(frozen=True)
class Certificate:
    """First-order optimality, phase by phase.

    Attributes:
        costates: at the elements' edges, shape (M + 1, nx) each; cost per unit of the state.
        hamiltonian: at both ends of every element, shape (M, 2) each.
        duration_multipliers: the derivatives of the least cost with respect to the phases'
            durations, shape (phases,).
        cost_gaps: about what each element's control costs too much, shape (M,) each.
        defect_costs: about what residuals of the differential equations add to the cost of every
            phase, shape (phases,).
        limit_costs: about what it costs that limits are violated, or kept with a margin, shape (M,)
            each.
        integral_costs: about what it costs that bounded integrals differ from the program's
            quadrature, shape (phases,).
        switches: of every phase, (element, fraction of it) where a control should switch but does
            not, shape (n, 2) each.
        integral_multipliers: of every phase's bounded integrals, shape (m,) each.
        scales: of the Hamiltonian, shape (phases,): that of the cost over the duration.
    """

    costates: tuple[Array, ...]
    hamiltonian: tuple[Array, ...]
    duration_multipliers: Array
    cost_gaps: tuple[Array, ...]
    defect_costs: Array
    limit_costs: tuple[Array, ...]
    integral_costs: Array
    switches: tuple[Array, ...]
    integral_multipliers: tuple[Array, ...]
    scales: Array

    @property
    def suboptimality(self) -> float:
        """About how far the cost is from the least, in its unit; the parts do not cancel."""
        of_elements = sum(each.sum() for each in (*self.cost_gaps, *self.limit_costs))
        return float(of_elements + abs(self.defect_costs.sum()) + self.integral_costs.sum())

    @property
    def hamiltonian_spread(self) -> float:
        """Largest deviation from its mean over a phase, relative to scale + largest magnitude."""
        pairs = zip(self.hamiltonian, self.scales, strict=True)
        with np.errstate(invalid="ignore"):  # a flow that is not finite
            spreads = [np.abs(h - h.mean()).max() / (s + np.abs(h).max()) for h, s in pairs]
        return float(np.nan_to_num(max(spreads), nan=np.inf))

    @property
    def transversality_error(self) -> float:
        """Largest gap between mean Hamiltonian and multiplier of duration, likewise relative."""
        each = zip(self.hamiltonian, self.duration_multipliers, self.scales, strict=True)
        return float(max(abs(h.mean() - of_T) / (s + abs(of_T)) for h, of_T, s in each))


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
    integrals = [np.zeros(0) for _ in problem.phases]
    for rows, multipliers in transcription.multipliers_of(result):
        if rows.kind == "integral":
            integrals[rows.phase] = multipliers
    views = [
        View(phase, trajectory, costates[i], result.parameters, integrals[i])
        for i, (phase, trajectory) in enumerate(zip(problem.phases, result.phases, strict=True))
    ]
    insides = [view.inside() for view in views]
    found, defects, limits = [], [], []
    for i, (view, inside) in enumerate(zip(views, insides, strict=True)):
        of_x, of_path = scales.phases[i].states, scales.phases[i].path
        multipliers = _limit_multipliers(transcription, result, i)
        multipliers *= np.concatenate([of_x, of_path])
        multipliers[multipliers < ACTIVE * scales.cost] = 0.0
        jump = np.abs(inside.from_left - inside.from_right).max(axis=1) * of_x
        limited = multipliers.any(axis=1) & (jump > ACTIVE * scales.cost).any(axis=1)
        found.append(gaps(view, inside, scales.phases[i], limited))
        defects.append(_defect_cost(view, inside))
        limits.append(_limit_costs(view, multipliers, scales.phases[i]))
    cost_gaps, switches = zip(*found, strict=True)
    errors = [finite(each).sum(axis=0)[1:] for _, each in quadratures(transcription, result)]
    widths = [t.element_durations / t.duration for t in result.phases]
    return Certificate(
        costates=tuple(costates),
        hamiltonian=tuple(view.hamiltonian(*view.at_ends()) for view in views),
        duration_multipliers=np.array([m @ w for m, w in zip(means, widths, strict=True)]),
        cost_gaps=cost_gaps,
        defect_costs=np.array(defects),
        limit_costs=tuple(limits),
        integral_costs=np.abs([a @ b for a, b in zip(errors, integrals, strict=True)]),
        switches=switches,
        integral_multipliers=tuple(integrals),
        scales=scales.cost / np.array([each.duration for each in scales.phases]),
    )


def _defect_cost(view: View, inside: Inside) -> float:
    """The integral of costate . (x' - flow): the cost that the differential equations' errors add.

    (Becker and Rannacher, An optimal control approach to a posteriori error estimation, Acta
    Numerica 10 (2001).)
    """
    h = view.trajectory.element_durations[:, None, None]
    flow = evaluated(view.phase.flow, inside.states, inside.controls, view.p)
    residual = SLOPE @ inside.states - h * finite(flow)
    return float(WEIGHTS @ (inside.costates() * residual).sum(axis=(0, 2)))


def _limit_multipliers(transcription: Transcription, result: Result, index: int) -> Array:
    """Multipliers of an element's bounds on states and path constraints, shape (M, nx + m).

    Those of a bound at an edge count on both sides.
    """
    layout, phase = transcription.layout, transcription.problem.phases[index]
    nx, m = len(phase.states), len(phase.path.names) if phase.path else 0
    bounds = np.abs(result.bound_multipliers)
    edges = bounds[layout.indices(index, "edges", 0)].T
    edges[[0, -1]] = 0.0  # the ends have their own bounds
    multipliers = np.hstack([edges[:-1] + edges[1:], np.zeros((len(edges) - 1, m))])
    for each in transcription.equations.element_blocks:
        if each.phase != index:
            continue
        scheme, chosen = each.group.scheme, each.group.elements
        interior = bounds[layout.indices(index, "interior", each.group.degree)]
        multipliers[chosen, :nx] += interior.reshape(-1, nx, len(chosen)).sum(axis=0).T
        first, nodes = nx * len(scheme.D), len(path_nodes(scheme))
        path = np.abs(result.multipliers[each.block.rows[first : first + m * nodes]])
        multipliers[chosen, nx:] = path.reshape(nodes, m, len(chosen)).sum(axis=0).T
    return multipliers


def _limit_costs(view: View, multipliers: Array, scales: PhaseScales) -> Array:
    """What limits cost that are not met exactly, shape (M,), given multipliers (M, nx + m).

    The multipliers are costs per scale of what is limited. A path constraint that an element
    violates has to be moved inwards in the whole phase.
    """
    limits = limits_on_grid(view.phase, view.trajectory, view.p, scales)
    states, _, *path = (excess.max(axis=1) for _, _, excess in limits)
    amounts, everywhere = np.hstack([states, *path]), multipliers.copy()
    everywhere[:, states.shape[1] :] = multipliers.sum(axis=0)[states.shape[1] :]
    factors = np.where(amounts > 0.0, everywhere, multipliers)
    return np.where(factors > 0.0, factors * np.abs(amounts), 0.0).sum(axis=1)


def quadratures(transcription: Transcription, result: Result) -> list[tuple[Array, Array]]:
    """Integrals of the running cost and the m integrands of every phase's elements, (M, 1 + m).

    And how far the program's own quadrature is from them.
    """
    s, weights = np.polynomial.legendre.leggauss(SAMPLES)
    found = []
    for phase, t in zip(transcription.problem.phases, result.phases, strict=True):
        x = lagrange_matrix(t.nodes, 0.5 + 0.5 * s) @ t.states
        u = lagrange_matrix(t.control_nodes, 0.5 + 0.5 * s) @ t.controls
        rates = running_cost(phase, x, u, result.parameters)[..., None]
        if phase.integral is not None:
            integrand = evaluated(phase.integral.function, x, u, result.parameters)
            rates = np.concatenate([rates, integrand], axis=-1)
        values = t.element_durations[:, None] * np.einsum("s,esm->em", 0.5 * weights, rates)
        found.append((values, values.copy()))
    for each in transcription.equations.element_blocks:
        block, errors = each.block, found[each.phase][1]
        mapped = block.function.map(block.count)
        outputs, cost = mapped(result.unknowns[block.variables], block.data)
        integrals = outputs.full()[len(block.rows) - (errors.shape[1] - 1) :]
        errors[each.group.elements] -= np.vstack([cost.full(), integrals]).T
    return found


def limits_on_grid(
    phase: Phase, trajectory: PhaseTrajectory, p: Array, scales: PhaseScales
) -> list[tuple[str, dict[str, float], Array]]:
    """Kind, scales of m names, and relative excesses (M, samples, m): states, controls, path.

    Excesses are negative inside. States are allowed what their ends, which have bounds of their
    own, are outside those all along.
    """
    x = lagrange_matrix(trajectory.nodes, GRID) @ trajectory.states
    u = lagrange_matrix(trajectory.control_nodes, GRID) @ trajectory.controls
    ends = np.stack([trajectory.start, trajectory.end])
    at_ends = np.maximum(beyond(ends, *phase.state_bounds()), 0.0).max(axis=0)
    limits = [
        ("bound", phase.states, scales.states, beyond(x, *phase.state_bounds()) - at_ends),
        ("bound", phase.controls, scales.controls, beyond(u, *phase.control_bounds())),
    ]
    if phase.path is not None:
        excess = beyond(evaluated(phase.path.function, x, u, p), phase.path.lower, phase.path.upper)
        limits.append(("path constraint", phase.path.names, scales.path, excess))
    return [
        (kind, dict(zip(names, units.tolist(), strict=True)), excess / units)
        for kind, names, units, excess in limits
    ]
