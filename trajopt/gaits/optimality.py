"""How optimal a gait is: the accuracy of its own optimum, and the other optima that were met."""

from __future__ import annotations

import dataclasses

from trajopt.ocp.extremal import Extremal


@dataclasses.dataclass(frozen=True)
class LocalOptimum:
    """A local optimum met in a search.

    Attributes:
        cot: its cost of transport.
        theta_turns: whole turns that theta gains in a stride.
        found: number of starts that led there.
    """

    cot: float
    theta_turns: int
    found: int


@dataclasses.dataclass(frozen=True)
class Optimality:
    """How accurately a gait was solved for, and how well it meets first-order optimality.

    Attributes:
        mesh_error: largest estimated relative error of the states within an element.
        hamiltonian_spread: see `trajopt.ocp.accuracy.Certificate`.
        transversality_error: see there as well.
    """

    mesh_error: float
    hamiltonian_spread: float
    transversality_error: float

    @classmethod
    def of(cls, found: Extremal) -> Optimality:
        """The optimality of a solved problem."""
        certificate = found.certificate
        return cls(
            found.mesh_error, certificate.hamiltonian_spread, certificate.transversality_error
        )
