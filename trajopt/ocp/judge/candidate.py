"""A result on a mesh together with the measures of how good it is."""

from __future__ import annotations

import dataclasses
from functools import cached_property

from trajopt.ocp.judge.accuracy import Quality, assess, cost_errors
from trajopt.ocp.judge.costates import Certificate, certificate
from trajopt.ocp.transcribe.nlp import Result, Transcription

#: By how much refining the mesh may raise the cost of one and the same optimum (relative).
SAME_COST = 5e-3


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
    """A result, measured when it is first asked for a measure.

    Attributes:
        transcription: what was solved.
        result: its solution.
    """

    transcription: Transcription
    result: Result

    @cached_property
    def certificate(self) -> Certificate:
        """Costates and Hamiltonian."""
        return certificate(self.transcription, self.result)

    @cached_property
    def qualities(self) -> tuple[Quality, ...]:
        """The errors of every phase."""
        result = self.result
        gaps = self.certificate.cost_gaps(result.phases, result.cost)
        errors = cost_errors(self.transcription, result)
        each = zip(self.transcription.problem.phases, result.phases, errors, gaps, strict=True)
        return tuple(
            assess(phase, trajectory, result.parameters, error, gap)
            for phase, trajectory, error, gap in each
        )

    @property
    def error(self) -> float:
        """Largest error of the states within an element; see `Quality.state_error`."""
        return float(max(quality.state_error.max() for quality in self.qualities))

    @property
    def overshoot(self) -> float:
        """Largest violation of a path constraint between the nodes."""
        return float(max(quality.path_violation.max() for quality in self.qualities))

    def dearer_than(self, other: Candidate) -> bool:
        """Whether it costs so much more that it must be another optimum."""
        cost = other.result.cost
        return self.result.cost - cost > SAME_COST * (1e-9 + abs(cost))
