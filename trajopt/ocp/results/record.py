"""What is known of a solved problem, and the verdict on it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.judge.costates import Certificate
from trajopt.ocp.judge.resimulation import Resimulation
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.nlp import DIVERGING
from trajopt.ocp.transcribe.rows import Breach
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory
from trajopt.provenance import provenance

#: How far states played back may be off, relative to the tolerance of the mesh.
RESIMULATION_FACTOR = 100.0

#: IPOPT's status for a success.
SUCCESS = "Solve_Succeeded"


@dataclasses.dataclass(frozen=True)
class Attempt:
    """One run of IPOPT.

    Attributes:
        elements: of the mesh, in all phases together.
        options: of IPOPT.
        status: IPOPT's name for how the run ended.
        iterations: that it took.
    """

    elements: int
    options: dict[str, Any]
    status: str
    iterations: int

    @property
    def succeeded(self) -> bool:
        """Whether IPOPT says so."""
        return self.status == SUCCESS


@dataclasses.dataclass(frozen=True, repr=False)
class Record:
    """What is known of a solved problem; see `trajopt.Extremal`.

    Attributes:
        problem: what was solved.
        mesh: the best one, on which the solution is given.
        phases: the trajectory, phase by phase.
        parameters: values of the static parameters, shape (np,).
        tolerance: the limit of `mesh_error`.
        limit_tolerance: of violations between the nodes.
        transcribed_cost: the objective of the nonlinear program.
        mesh_error: largest estimated relative error of the states within an element.
        status: IPOPT's name for how the run on `mesh` ended.
        attempts: every run of IPOPT, in order; the last may be on a mesh that was given up.
        breaches: constraints that the program's solution violates, worst first.
        audit: limits that are violated between the nodes, worst first.
        certificate: costates and Hamiltonian.
        resimulation: the solution played back; None if that was not asked for.
        provenance: versions and git revision.
    """

    problem: Problem
    mesh: Mesh
    phases: tuple[PhaseTrajectory, ...]
    parameters: Array
    tolerance: float
    limit_tolerance: float
    transcribed_cost: float
    mesh_error: float
    status: str
    attempts: tuple[Attempt, ...]
    breaches: tuple[Breach, ...]
    audit: tuple[Breach, ...]
    certificate: Certificate
    resimulation: Resimulation | None
    provenance: dict[str, Any] = dataclasses.field(default_factory=provenance)

    @property
    def cost(self) -> float:
        """The objective along the solution played back, or else `transcribed_cost`."""
        if self.resimulation is None:
            return self.transcribed_cost
        return self.resimulation.cost

    @property
    def duration(self) -> float:
        """Sum of the phases' durations (s)."""
        return sum(phase.duration for phase in self.phases)

    @property
    def cost_gaps(self) -> tuple[Array, ...]:
        """What each element may cost too much; see `Certificate.cost_gaps`."""
        return self.certificate.cost_gaps(self.phases, self.cost)

    @property
    def succeeded(self) -> bool:
        """Whether IPOPT solved the program on the mesh; this says nothing about accuracy."""
        return self.status == SUCCESS

    @property
    def converged(self) -> bool:
        """Whether nothing is wrong.

        That is: IPOPT succeeded, the mesh is fine enough, limits hold, and playing the solution
        back agrees with it.
        """
        return not self.failures

    @property
    def failures(self) -> tuple[str, ...]:
        """What is wrong, in words; empty if the solution converged."""
        found = []
        if not self.succeeded:
            found.append(f"IPOPT: {self.status}{self._runs_away}")
        found += [str(breach) for breach in self.breaches[:3]]
        if not self.mesh_error <= self.tolerance:
            found.append(f"mesh error {self.mesh_error:.1e} exceeds {self.tolerance:.1e}")
        found += [
            f"between the nodes, {b}" for b in self.audit[:3] if b.amount > self.limit_tolerance
        ]
        if self.resimulation is not None:
            worst = max(self.resimulation.phase_errors)
            if not worst <= RESIMULATION_FACTOR * self.tolerance:
                found.append(f"played back, a phase is off by {worst:.1e}")
        return tuple(found)

    @property
    def _runs_away(self) -> str:
        if self.status != DIVERGING:
            return ""
        name, size = largest(self.problem, self.phases, self.parameters)
        return (
            f": {name} grew to {size:.1e} and the cost came to {self.transcribed_cost:.1e}: it has "
            "no minimum, or limits contradict each other; bound what grows"
        )

    @property
    def verdict(self) -> str:
        """Whether the solution converged, or why not, in one line."""
        return "converged" if self.converged else "FAILED: " + "; ".join(self.failures)


def largest(
    problem: Problem, phases: Sequence[PhaseTrajectory], parameters: Array
) -> tuple[str, float]:
    """A description of a solution's largest quantity, and its magnitude."""
    sizes = {
        f"parameter {name}": abs(float(value))
        for name, value in zip(problem.parameters, parameters, strict=True)
    }
    for phase, trajectory in zip(problem.phases, phases, strict=True):
        sizes[f"the duration of phase {phase.name!r}"] = abs(trajectory.duration)
        both = (phase.states, trajectory.states), (phase.controls, trajectory.controls)
        for names, values in both:
            for name, size in zip(names, np.abs(values).max(axis=(0, 1)), strict=True):
                sizes[f"{name} of phase {phase.name!r}"] = float(size)
    return max(sizes.items(), key=lambda item: item[1])
