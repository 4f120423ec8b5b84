"""What every transcription takes and returns: a mesh and a result."""

from __future__ import annotations

import dataclasses

import numpy as np

from trajopt.interpolant import PhaseTrajectory

#: Of the control: arcs of coasting, V = K psi', are curved.
CONTROL_DEGREE = 3


@dataclasses.dataclass(frozen=True)
class Mesh:
    """Elements of every phase.

    Attributes:
        fractions: for each phase the element edges as fractions of its duration, from 0 to 1.
        degree: of the state polynomials.
        control_degree: of the control polynomials.
    """

    fractions: tuple[tuple[float, ...], ...]
    degree: int
    control_degree: int = CONTROL_DEGREE

    @classmethod
    def uniform(cls, phases: int, elements: int, degree: int) -> Mesh:
        """The same equal elements in every phase."""
        edges = tuple(float(s) for s in np.linspace(0.0, 1.0, elements + 1))
        return cls((edges,) * phases, degree)


@dataclasses.dataclass(frozen=True)
class Result:
    """What IPOPT returned.

    Attributes:
        phases: the trajectory, phase by phase.
        cost: the objective, as the transcription sees it.
        success: IPOPT's verdict.
        status: IPOPT's words for it.
        iterations: of IPOPT.
        violation: the largest violation of any constraint.
        worst: the constraint that is violated most.
    """

    phases: tuple[PhaseTrajectory, ...]
    cost: float
    success: bool
    status: str
    iterations: int
    violation: float
    worst: str
