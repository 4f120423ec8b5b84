"""A solved problem: its trajectory, and what is known of its accuracy and optimality."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rimless_gym.checks import real
from trajopt.ocp.judge.costates import Certificate
from trajopt.ocp.judge.resimulation import Resimulation
from trajopt.ocp.pose.problem import Array, Problem
from trajopt.ocp.solving.minimum import largest
from trajopt.ocp.transcribe.mesh import Mesh
from trajopt.ocp.transcribe.nlp import DIVERGING
from trajopt.ocp.transcribe.rows import Breach
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory, require_side
from trajopt.provenance import provenance

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Of re-simulated against interpolated states, relative to the tolerance of the mesh.
RESIMULATION_FACTOR = 100.0

#: In IPOPT's words.
SUCCESS = "Solve_Succeeded"


@dataclasses.dataclass(frozen=True)
class Attempt:
    """One run of IPOPT: on how many elements, with which options, how it ended, iterations."""

    elements: int
    options: dict[str, Any]
    status: str
    iterations: int

    @property
    def succeeded(self) -> bool:
        """Whether IPOPT says so."""
        return self.status == SUCCESS


@dataclasses.dataclass(frozen=True, repr=False)
class Extremal:
    """A trajectory that satisfies the first-order conditions of optimality, or the nearest miss.

    Attributes:
        problem: what was solved.
        mesh: the last, and best.
        phases: the trajectory, phase by phase.
        parameters: values of the static parameters, shape (np,).
        tolerance: that was asked of `mesh_error`.
        limit_tolerance: that was asked of limits between the nodes.
        transcribed_cost: as the transcription sees it.
        mesh_error: largest estimated relative error of the states within an element.
        status: IPOPT's words for the run on `mesh`.
        attempts: every run of IPOPT, in order; the last one may be on a mesh that was given up.
        breaches: constraints that the last of them violates, worst first.
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
        """The objective, by quadrature along the solution played back."""
        if self.resimulation is None:
            return self.transcribed_cost
        return self.resimulation.cost

    @property
    def succeeded(self) -> bool:
        """Whether IPOPT solved the program on the mesh; accuracy is another question."""
        return self.status == SUCCESS

    @property
    def failures(self) -> tuple[str, ...]:
        """What is wrong with it, in words; empty if it converged."""
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
    def converged(self) -> bool:
        """Whether IPOPT succeeded, the mesh is fine enough, limits hold, playing it back agrees."""
        return not self.failures

    @property
    def duration(self) -> float:
        """Sum of the phases' durations (s)."""
        return sum(phase.duration for phase in self.phases)

    @property
    def cost_gaps(self) -> tuple[Array, ...]:
        """What each element may cost too much; see `Certificate.cost_gaps`."""
        return self.certificate.cost_gaps(self.phases, self.cost)

    def __repr__(self) -> str:
        verdict = "converged" if self.converged else "FAILED: " + "; ".join(self.failures)
        return f"Extremal(cost {self.cost:.6g}, {len(self.phases)} phase(s), {verdict})"

    def report(self) -> str:
        """Everything worth knowing, as text; failures in capitals."""
        verdict = "converged" if self.converged else "FAILED: " + "; ".join(self.failures)
        elements = ", ".join(str(len(d)) for d in self.mesh.degrees)
        runs = len(self.attempts)
        lines = [
            f"Optimal control, {len(self.phases)} phase(s), {self.duration:.6g} s",
            f"  verdict              {verdict}",
            f"  cost                 {self.cost:.9g} (transcribed {self.transcribed_cost:.9g})",
            f"  mesh                 {self.mesh.scheme}, {elements} elements, "
            f"error {self.mesh_error:.1e}",
            f"  IPOPT                {runs} run(s), "
            f"{sum(a.iterations for a in self.attempts)} iterations",
            f"  Hamiltonian          spread {self.certificate.hamiltonian_spread:.1e}, "
            f"transversality {self.certificate.transversality_error:.1e}",
        ]
        gap = sum(gaps.sum() for gaps in self.cost_gaps)
        lines.append(
            f"  control              costs up to {gap:.1e} (relative) too much, by the above"
        )
        if self.resimulation is not None:
            lines.append(
                f"  played back          off by {max(self.resimulation.phase_errors):.1e} a phase, "
                f"{self.resimulation.chain_error:.1e} in all"
            )
        for name, value in zip(self.problem.parameters, self.parameters, strict=True):
            lines.append(f"  parameter            {name} = {value:.9g}")
        for phase, trajectory in zip(self.problem.phases, self.phases, strict=True):
            pairs = zip(phase.states, trajectory.end, strict=True)
            end = ", ".join(f"{name} {value:.6g}" for name, value in pairs)
            lines.append(f"  {phase.name:<20} {trajectory.duration:.6g} s, ends at {end}")
        lines += [f"  between the nodes    {breach}" for breach in self.audit[:5]]
        retried = [a for a in self.attempts if not a.succeeded]
        lines += [f"  retried              {a.status} with {a.options}" for a in retried]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Figures and provenance as plain JSON values (infinities and NaN as null)."""
        from trajopt.ocp.judge import saved

        return saved.figures(self)

    def save(self, path: str | Path) -> None:
        """Write everything but the problem to an .npz file."""
        from trajopt.ocp.judge import saved

        saved.save(self, path)

    @classmethod
    def load(cls, path: str | Path, problem: Problem) -> Extremal:
        """Read what `save` wrote, a solution of `problem`; see `trajopt.ocp.judge.saved`."""
        from trajopt.ocp.judge import saved

        return saved.load(path, problem)

    def plot(self, path: str | Path | None = None) -> Figure:
        """States, controls and Hamiltonian against time; see `trajopt.ocp.judge.plots`.

        Args:
            path: of a picture to write besides.
        """
        from trajopt.ocp.judge import plots

        return plots.plotted(self, path)

    def state(self, t: float, side: str = "right") -> Array:
        """State at time t (s) from the start of the first phase, phases one after the other."""
        phase, local = self._locate(t, side)
        return np.asarray(self.phases[phase].state(local)[0])

    def control(self, t: float, side: str = "right") -> Array:
        """Control (nu,) at time t (s), likewise."""
        phase, local = self._locate(t, side)
        return np.asarray(self.phases[phase].control(local, side)[0])

    def _locate(self, t: float, side: str) -> tuple[int, float]:
        t = real("t", t)
        require_side(side)
        ends = np.cumsum([phase.duration for phase in self.phases])
        if not -1e-12 <= t <= ends[-1] * (1 + 1e-12):
            raise ValueError(f"t = {t}: must be from 0 to {ends[-1]} s")
        index = int(np.searchsorted(ends, t, side=side))  # type: ignore[call-overload]
        index = min(index, len(self.phases) - 1)
        return index, t - (ends[index] - self.phases[index].duration)
