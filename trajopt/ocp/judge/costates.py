"""Costates and Hamiltonian of a solution on a mesh: how close its control is to optimal.

The costate at an element's edge is the derivative of the remaining cost with respect to the state
there; it is computed from the next element's Lagrangian. At an optimum the Hamiltonian, running
cost + costate . flow, is constant along every phase, because nothing depends on time explicitly. It
equals the price of the phase's duration: the derivative of the phase's least cost with respect to
it. (A bounded integral counts as a running cost, priced at its multiplier.) Both hold for the
continuous problem; how well they hold on a mesh tells how good the mesh is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import casadi as ca
import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.pose.phase import Phase
from trajopt.ocp.transcribe.nlp import Result, Transcription
from trajopt.ocp.transcribe.packing import evaluated
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory


@dataclasses.dataclass(frozen=True)
class Certificate:
    """First-order optimality, phase by phase.

    Attributes:
        costates: at the elements' edges, shape (M + 1, nx) each; cost per unit of the state.
        hamiltonian: at both ends of every element, shape (M, 2) each.
        mean_hamiltonian: of every element in the program: the derivative of the least cost with
            respect to the element's duration, shape (M,) each.
        duration_price: the same with respect to each phase's duration, shape (phases,).
    """

    costates: tuple[Array, ...]
    hamiltonian: tuple[Array, ...]
    mean_hamiltonian: tuple[Array, ...]
    duration_price: Array

    @property
    def hamiltonian_spread(self) -> float:
        """Largest deviation from its mean over a phase, relative to 1 + its largest magnitude."""
        spreads = [np.abs(h - h.mean()).max() / (1 + np.abs(h).max()) for h in self.hamiltonian]
        return float(max(spreads))

    @property
    def transversality_error(self) -> float:
        """Largest gap between the mean Hamiltonian and the price of duration, likewise relative."""
        pairs = zip(self.hamiltonian, self.duration_price, strict=True)
        return float(max(abs(h.mean() - price) / (1 + abs(price)) for h, price in pairs))

    def cost_gaps(self, phases: Sequence[PhaseTrajectory], cost: float) -> tuple[Array, ...]:
        """What each element may cost too much, relative to 1 + |cost|, shape (M,) per phase.

        Where the control is not optimal, for example because the optimal one switches within the
        element, the Hamiltonian varies. Its variation times the element's duration is a cost.
        """
        gaps = []
        for ends, mean, phase in zip(self.hamiltonian, self.mean_hamiltonian, phases, strict=True):
            all_three = np.column_stack([ends, mean])
            gaps.append(np.ptp(all_three, axis=1) * phase.element_durations / (1 + abs(cost)))
        return tuple(gaps)


def certificate(transcription: Transcription, result: Result) -> Certificate:
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
    prices = {(rows.kind, rows.phase): mu for rows, mu in transcription.multipliers_of(result)}
    hamiltonians = [
        hamiltonian(phase, trajectory, costates[i], result.parameters, prices.get(("integral", i)))
        for i, (phase, trajectory) in enumerate(zip(problem.phases, result.phases, strict=True))
    ]
    widths = [t.element_durations / t.duration for t in result.phases]
    price = np.array([mean @ width for mean, width in zip(means, widths, strict=True)])
    return Certificate(tuple(costates), tuple(hamiltonians), tuple(means), price)


def hamiltonian(
    phase: Phase,
    trajectory: PhaseTrajectory,
    costates: Array,
    p: Array,
    prices: Array | None = None,
) -> Array:
    """The Hamiltonian at both ends of every element, shape (M, 2).

    Args:
        phase: whose flow and costs count.
        trajectory: of the phase.
        costates: at the elements' edges, shape (M + 1, nx).
        p: static parameters.
        prices: multipliers of the phase's integral constraints, if it has any.
    """
    x, u = trajectory.states[:, [0, -1]], trajectory.controls[:, [0, -1]]
    rates = np.stack([costates[:-1], costates[1:]], axis=1)
    value = np.einsum("esx,esx->es", rates, evaluated(phase.flow, x, u, p))
    if phase.integral is not None and prices is not None:
        value = value + evaluated(phase.integral.function, x, u, p) @ prices
    return np.asarray(value + running_cost(phase, x, u, p))


def running_cost(phase: Phase, x: Array, u: Array, p: Array) -> Array:
    """What is paid per second at states (..., nx) and controls (..., nu)."""
    paid = np.zeros(x.shape[:-1])
    if phase.cost is not None:
        paid = paid + evaluated(phase.cost, x, u, p)[..., 0]
    if phase.powers is not None:
        paid = paid + np.maximum(evaluated(phase.powers, x, u, p), phase.floor).sum(axis=-1)
    return np.asarray(paid)
