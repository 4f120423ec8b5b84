"""How a problem is discretised: a scheme, the elements of every phase, and their degrees."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trajopt.problem import Problem
from trajopt.schemes import Scheme, hermite_simpson, radau, trapezoid

#: Degree of the state between the nodes, of schemes that have one of their own.
FIXED_DEGREE = {"trapezoid": 2, "hermite-simpson": 3}

SCHEMES = (*FIXED_DEGREE, "radau")


@dataclasses.dataclass(frozen=True)
class Mesh:
    """Elements of every phase.

    Attributes:
        fractions: for each phase the element edges as fractions of its duration, from 0 to 1.
        degrees: for each phase the degree of the state on each element.
        scheme: "trapezoid", "hermite-simpson" or "radau".
        control_degree: cap on the control's degree under "radau"; None for the state's less one.
    """

    fractions: tuple[tuple[float, ...], ...]
    degrees: tuple[tuple[int, ...], ...]
    scheme: str = "radau"
    control_degree: int | None = None

    def __post_init__(self) -> None:
        """Check that the edges are in order and that every element has a degree."""
        if self.scheme not in SCHEMES:
            raise ValueError(f"scheme = {self.scheme!r}: choose from {SCHEMES}")
        for edges, degrees in zip(self.fractions, self.degrees, strict=True):
            if edges[0] != 0.0 or edges[-1] != 1.0 or min(np.diff(edges)) <= 0.0:
                raise ValueError(f"fractions = {edges}: must increase from 0 to 1")
            if len(degrees) != len(edges) - 1 or min(degrees) < 1:
                raise ValueError(
                    f"degrees = {degrees}: give each of the {len(edges) - 1} elements one, >= 1"
                )

    @classmethod
    def uniform(
        cls,
        phases: int | Problem,
        elements: int | Sequence[int] = 10,
        degree: int = 4,
        scheme: str = "radau",
        control_degree: int | None = None,
    ) -> Mesh:
        """Equal elements within every phase.

        Args:
            phases: how many, or a problem that has them.
            elements: per phase, one number for all or one each.
            degree: of the state, for "radau".
            scheme: see `Mesh`.
            control_degree: see `Mesh`.
        """
        count = phases if isinstance(phases, int) else len(phases.phases)
        each = [elements] * count if isinstance(elements, int) else list(elements)
        if len(each) != count or min(each) < 1:
            raise ValueError(f"elements = {elements}: give each of the {count} phases at least 1")
        edges = tuple(tuple(float(s) for s in np.linspace(0.0, 1.0, n + 1)) for n in each)
        degree = FIXED_DEGREE.get(scheme, degree)
        return cls(edges, tuple((degree,) * n for n in each), scheme, control_degree)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Mesh:
        """The mesh of which `dataclasses.asdict`, or JSON of it, gave `values`."""
        tables = {name: tuple(map(tuple, values[name])) for name in ("fractions", "degrees")}
        return cls(**{**values, **tables})

    def scheme_of_degree(self, degree: int) -> Scheme:
        """The scheme on elements of a degree."""
        if self.scheme == "radau":
            return radau(degree, self.control_degree)
        return trapezoid() if self.scheme == "trapezoid" else hermite_simpson()

    @property
    def elements(self) -> int:
        """How many there are in all phases together."""
        return sum(map(len, self.degrees))
