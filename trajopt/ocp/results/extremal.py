"""A solved problem, as users see it: states and controls by time, report, file, picture."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.checks import real
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.results import saved
from trajopt.ocp.results.record import Record
from trajopt.ocp.transcribe.trajectory import require_side

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclasses.dataclass(frozen=True, repr=False)
class Extremal(Record):
    """A trajectory that satisfies the first-order conditions of optimality, or the nearest miss.

    Its attributes, and the verdict on it (`converged`, `failures`), are those of a `Record`.
    """

    def state(self, t: float, side: str = "right") -> Array:
        """State (nx,) at time t (s) from the start of the first phase, with phases in a row.

        Args:
            t: from 0 to `duration`.
            side: "left" or "right", where one phase ends and the next begins.

        Raises:
            TypeError: t is not a real number.
            ValueError: t or `side` is out of its range.
        """
        phase, local = self._locate(t, side)
        return np.asarray(self.phases[phase].state(local)[0])

    def control(self, t: float, side: str = "right") -> Array:
        """Control (nu,) at time t (s), likewise; `side` matters wherever the control jumps."""
        phase, local = self._locate(t, side)
        return np.asarray(self.phases[phase].control(local, side)[0])

    def _locate(self, t: float, side: str) -> tuple[int, float]:
        """The index of the phase at time t, and the time from that phase's start."""
        t = real("t", t)
        require_side(side)
        ends = np.cumsum([phase.duration for phase in self.phases])
        if not -1e-12 <= t <= ends[-1] * (1 + 1e-12):
            raise ValueError(f"t = {t}: must be from 0 to {ends[-1]} s")
        index = int(np.searchsorted(ends, t, side=side))  # type: ignore[call-overload]
        index = min(index, len(self.phases) - 1)
        return index, t - (ends[index] - self.phases[index].duration)

    def __repr__(self) -> str:
        return f"Extremal(cost {self.cost:.6g}, {len(self.phases)} phase(s), {self.verdict})"

    def report(self) -> str:
        """Everything worth knowing, as text; failures in capitals."""
        elements = ", ".join(str(len(d)) for d in self.mesh.degrees)
        iterations = sum(a.iterations for a in self.attempts)
        gap = sum(gaps.sum() for gaps in self.cost_gaps)
        lines = [
            f"Optimal control, {len(self.phases)} phase(s), {self.duration:.6g} s",
            f"  verdict              {self.verdict}",
            f"  cost                 {self.cost:.9g} (transcribed {self.transcribed_cost:.9g})",
            f"  mesh                 {self.mesh.scheme}, {elements} elements, "
            f"error {self.mesh_error:.1e}",
            f"  IPOPT                {len(self.attempts)} run(s), {iterations} iterations",
            f"  Hamiltonian          spread {self.certificate.hamiltonian_spread:.1e}, "
            f"transversality {self.certificate.transversality_error:.1e}",
            f"  control              costs up to {gap:.1e} (relative) too much, by the above",
        ]
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
        return saved.figures(self)

    def save(self, path: str | Path) -> None:
        """Write everything but the problem to an .npz file.

        Raises:
            OSError: it cannot be written.
        """
        saved.save(self, path)

    @classmethod
    def load(cls, path: str | Path, problem: Problem) -> Extremal:
        """Read what `save` wrote, a solution of `problem`.

        Raises:
            FileNotFoundError: there is no such file.
            ExtremalFileError: it is not a solution saved by this version, was edited or damaged,
                or is of another problem.
        """
        return saved.load(path, problem, cls)

    def plot(self, path: str | Path | None = None) -> Figure:
        """States, controls and Hamiltonian against time; see `trajopt.ocp.results.plots.drawn`.

        Args:
            path: where to write a picture too, if anywhere; its suffix says which kind.
        """
        from trajopt.ocp.results.plots import drawn  # matplotlib takes a second to import

        verdict = "converged" if self.converged else "FAILED: " + self.failures[0]
        title = f"cost {self.cost:.6g}, {verdict}"
        figure = drawn(self.problem, self.phases, self.parameters, title, self.certificate)
        if path is not None:
            figure.savefig(Path(path))
        return figure
