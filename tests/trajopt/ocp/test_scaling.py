"""A problem in other units has the same solution, to the same digits, and the same verdict."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np
import pytest

from scripts.studies.textbook import PROBLEMS, Example
from tests.trajopt.ocp.problems import solved
from tests.trajopt.ocp.test_multi_start import AROUND
from trajopt import Constraint, Linkage, Phase, Problem, multi_start, solve
from trajopt.ocp.constraints import pair
from trajopt.ocp.guesses import Waypoints


@dataclasses.dataclass(frozen=True)
class Units:
    """By what the numbers of a problem are multiplied: states and controls by name."""

    values: Mapping[str, float] = dataclasses.field(default_factory=dict)
    time: float = 1.0
    cost: float = 1.0

    def of(self, names: tuple[str, ...]) -> np.ndarray:
        return np.array([self.values.get(name, 1.0) for name in names])

    def problem(self, old: Problem) -> Problem:
        """The same problem in these units."""
        phases = tuple(map(self.phase, old.phases))
        units = [self.of(phase.states) for phase in phases]

        def at_ends(function: Any, factor: float) -> Any:
            def changed(starts: Any, ends: Any, durations: Any, p: Any) -> Any:
                x0, x1 = (
                    ca.vertcat(*(x / u for x, u in zip(each, units, strict=True)))
                    for each in (starts, ends)
                )
                return factor * function(x0, x1, ca.vertcat(*durations) / self.time, p)

            return function and changed

        links = tuple(
            Linkage(
                *(k.source, k.target),
                lambda x, p, k=k: units[k.target] * k.map(x / units[k.source], p),
                {n: v * self.values.get(n, 1.0) for n, v in k.offset.items()},
            )
            for k in old.linkages
        )
        boundary = old.boundary
        if boundary is not None:
            changed = at_ends(boundary.function, 1.0)
            boundary = Constraint(changed, boundary.lower, boundary.upper, boundary.names)
        return Problem(
            phases,
            links,
            old.parameters,
            tuple(self.time * b for b in pair(old.duration)),
            boundary,
            at_ends(old.endpoint_cost, self.cost),
        )

    def phase(self, old: Phase) -> Phase:
        a, b = self.of(old.states), self.of(old.controls)

        def along(function: Any, factor: Any) -> Any:
            return function and (lambda x, u, p: factor * function(x / a, u / b, p))

        def constraint(old: Constraint | None, at: bool, factor: float = 1.0) -> Any:
            function = old and (
                (lambda x, p: old.function(x / a, p)) if at else along(old.function, factor)
            )
            return old and Constraint(function, old.lower, old.upper, old.names)

        def bounds(old: Mapping[str, Any]) -> dict[str, Any]:
            units = {name: self.values.get(name, 1.0) for name in old}
            return {n: tuple(units[n] * v for v in pair(b)) for n, b in old.items()}

        rate = self.cost / self.time
        return Phase(
            *(old.name, old.states, along(old.flow, a / self.time), old.controls),
            cost=along(old.cost, rate),
            powers=along(old.powers, rate),
            floor=rate * old.floor,
            path=constraint(old.path, False),
            integral=constraint(old.integral, False, 1 / self.time),
            at_start=constraint(old.at_start, True),
            at_end=constraint(old.at_end, True),
            **{name: bounds(getattr(old, name)) for name in ("bounds", "start", "end")},
            duration=tuple(self.time * b for b in pair(old.duration)),
        )


UNITS = {
    "cost": Units(cost=1e-6),
    "time": Units(time=1e6),
    "a state": Units({"v": 1e6, "height": 1e6}),
    "all states": Units(dict.fromkeys(("x", "y", "v", "height"), 1e-6)),
    "a control": Units({"force": 1e6, "u": 1e-6, "slope": 1e-3}),
}
NAMES = "brachistochrone", "hanging chain", "fastest move", "bryson denham"


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("units", UNITS)
def test_a_solution_and_its_verdict_do_not_depend_on_units(name: str, units: str) -> None:
    example = next(example for example in PROBLEMS if example.name == name)
    found = solve(UNITS[units].problem(example.problem()))
    assert found.converged, found.report()
    cost = found.cost / UNITS[units].cost
    assert cost == pytest.approx(solved(name).cost, rel=1e-9)
    assert cost == pytest.approx(example.known(), rel=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1e-6, 1e6])
@pytest.mark.parametrize("example", PROBLEMS, ids=lambda e: e.name)
def test_no_unit_of_any_textbook_problem_matters(example: Example, factor: float) -> None:
    problem = example.problem()
    names = {name for phase in problem.phases for name in phase.states + phase.controls}
    every = [Units(cost=factor), Units(time=factor), *(Units({name: factor}) for name in names)]
    for units in every:
        found = solve(units.problem(problem))
        assert found.converged, found.report()
        assert found.cost / units.cost == pytest.approx(solved(example.name).cost, rel=1e-7)


@pytest.mark.parametrize(
    "units",
    [Units(cost=1e-6), Units(time=1e6), Units({"x": 1e6, "y": 1e-6, "vx": 1e-3, "vy": 1e3})],
)
def test_a_search_finds_the_same_optima_from_the_same_starts_in_any_units(units: Units) -> None:
    search, changed = (
        multi_start(problem, Waypoints(problem), 5) for problem in (AROUND, units.problem(AROUND))
    )
    assert len(search.optima) > 1
    assert [each.starts for each in changed.optima] == [each.starts for each in search.optima]
    costs = [each.cost / units.cost for each in changed.optima]
    assert costs == pytest.approx([each.cost for each in search.optima], rel=1e-6)
