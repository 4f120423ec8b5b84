"""How a problem is discretised: a scheme, the elements of every phase, and their degrees."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rimless_gym.checks import integer, real_array
from trajopt.ocp.arrays import Indices
from trajopt.ocp.problem import Problem
from trajopt.ocp.schemes import SCHEMES, Scheme

#: Largest degree. An element's work grows with the cube of its degree, and beyond this the error
#: no longer falls: tracing takes a second at degree 40, and minutes at 200.
MOST_DEGREE = 40


@dataclasses.dataclass(frozen=True)
class Mesh:
    """Elements of every phase.

    Attributes:
        fractions: for each phase the element edges as fractions of its duration, from 0 to 1.
        degrees: for each phase the degree of the state on each element.
        scheme: its name in `SCHEMES`: "trapezoid", "hermite-simpson" or "radau".
        control_degree: the control's highest degree under "radau"; None for the state's less one.
    """

    fractions: tuple[tuple[float, ...], ...]
    degrees: tuple[tuple[int, ...], ...]
    scheme: str = "radau"
    control_degree: int | None = None

    def __post_init__(self) -> None:
        _require_scheme(self.scheme)
        if len(self.fractions) != len(self.degrees):
            raise ValueError(
                f"fractions are given for {len(self.fractions)} phases, degrees for "
                f"{len(self.degrees)}: give both for every phase"
            )
        for edges, degrees in zip(self.fractions, self.degrees, strict=True):
            array = real_array("fractions", edges)
            increasing = array.ndim == 1 and len(array) > 1 and (np.diff(array) > 0.0).all()
            if not increasing or array[0] != 0.0 or array[-1] != 1.0:
                raise ValueError(f"fractions = {edges}: must increase from 0 to 1")
            if len(degrees) != len(edges) - 1:
                raise ValueError(
                    f"degrees = {degrees}: give one for each of the {len(edges) - 1} elements, >= 1"
                )
            for degree in degrees:
                integer("degrees", degree, 1, MOST_DEGREE)
        if self.control_degree is not None:
            integer("control_degree", self.control_degree, 1, MOST_DEGREE)

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
            phases: how many, or the problem.
            elements: per phase: one number for all phases, or one for each.
            degree: of the state, for "radau"; at most `MOST_DEGREE`.
            scheme: see `Mesh`.
            control_degree: see `Mesh`.

        Raises:
            ValueError: an argument is out of its range.
        """
        count = len(phases.phases) if isinstance(phases, Problem) else phases
        each = list(elements) if isinstance(elements, Sequence) else [elements] * count
        if len(each) != count:
            raise ValueError(
                f"elements = {elements}: give one number for all {count} phases, or one for each"
            )
        _require_scheme(scheme)
        edges = tuple(tuple(float(s) for s in np.linspace(0.0, 1.0, n + 1)) for n in each)
        degree = SCHEMES[scheme].degree or degree
        return cls(edges, tuple((degree,) * n for n in each), scheme, control_degree)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Mesh:
        """The mesh that `dataclasses.asdict` turned into `values`, even as lists of JSON."""
        tables = {name: tuple(map(tuple, values[name])) for name in ("fractions", "degrees")}
        return cls(**{**values, **tables})

    def scheme_of_degree(self, degree: int) -> Scheme:
        """The scheme of elements of this degree."""
        return SCHEMES[self.scheme].of_degree(degree, self.control_degree)

    def groups(self, phase: int) -> tuple[Group, ...]:
        """The elements of a phase by degree."""
        degrees = np.array(self.degrees[phase])
        return tuple(
            Group(int(d), self.scheme_of_degree(int(d)), np.flatnonzero(degrees == d))
            for d in np.unique(degrees)
        )

    @property
    def elements(self) -> int:
        """How many elements all phases have together."""
        return sum(map(len, self.degrees))


@dataclasses.dataclass(frozen=True)
class Group:
    """The elements of one degree of a phase: the scheme, and their indices, ascending."""

    degree: int
    scheme: Scheme
    elements: Indices


def _require_scheme(scheme: Any) -> None:
    if not isinstance(scheme, str) or scheme not in SCHEMES:
        raise ValueError(f"scheme = {scheme!r}: choose from {tuple(SCHEMES)}")
