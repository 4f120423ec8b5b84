"""A linkage: how the end of one phase determines the start of another."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.checks import integer, real
from trajopt.ocp.pose.constraint import Expression
from trajopt.ocp.pose.phase import Phase
from trajopt.ocp.pose.tracing import trace


@dataclasses.dataclass(frozen=True)
class Linkage:
    """x at the start of phase `target` = map(x at the end of phase `source`, p) + offset.

    Attributes:
        source: index of a phase.
        target: index of a phase; an earlier or the same one closes a cycle.
        map: (x, p) -> x, any reset map; the identity by default.
        offset: constant shift by state, such as whole turns of an angle; none by default.
    """

    source: int
    target: int
    map: Expression = lambda x, p: x
    offset: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check types and numbers. Only the problem knows whether the phases exist."""
        for side in ("source", "target"):
            integer(f"linkage: {side}", getattr(self, side), 0)
        if not isinstance(self.offset, Mapping):
            raise TypeError(f"linkage: offset = {self.offset!r}: must be a mapping, name: number")
        for name, value in self.offset.items():
            real(f"linkage: offset of {name}", value)

    def traced(self, phases: Sequence[Phase], parameters: int) -> Linkage:
        """This linkage with its map traced, for these phases and so many static parameters.

        Raises:
            TypeError: the map is not a function.
            ValueError: there is no such phase or state, or the map cannot be traced or gives the
                wrong number of states.
        """
        for side, index in (("source", self.source), ("target", self.target)):
            if not 0 <= index < len(phases):
                raise ValueError(
                    f"linkage: {side} = {index}: there are {len(phases)} phases, from 0"
                )
        source, target = phases[self.source], phases[self.target]
        unknown = [name for name in self.offset if name not in target.states]
        if unknown:
            raise ValueError(f"linkage: offset names {unknown}, not among {target.states}")
        where = f"linkage from {source.name!r} to {target.name!r}: map"
        reset = trace(where, self.map, len(source.states), parameters)
        if reset.size1_out(0) != len(target.states):
            raise ValueError(
                f"linkage from {source.name!r} to {target.name!r}: its map gives "
                f"{reset.size1_out(0)} numbers for the {len(target.states)} states {target.states}"
            )
        return dataclasses.replace(self, map=reset)

    def offset_of(self, states: Sequence[str]) -> Array:
        """The offset as a vector, of the target's states (nx,)."""
        return np.array([self.offset.get(name, 0.0) for name in states])
