"""Linkages join phases: by jumps, in cycles, modulo whole turns, with different states."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from tests.trajopt.ocp.problems import move, solve_once
from trajopt import Constraint, Extremal, Linkage, Mesh, Phase, Problem, solve
from trajopt.ocp.guesses import line


def block(name: str, **more: Any) -> Phase:
    """A block of 1 kg, 1 s long, at least effort."""
    return move(name=name, **{"start": {}, "end": {}} | more)


def two_halves(**link: Any) -> Problem:
    """From rest to rest 2 m away in 2 s."""
    return Problem(halves(), (Linkage(0, 1, **link),))


def halves() -> tuple[Phase, Phase]:
    return block("first", start={"x": 0.0, "v": 0.0}), block("second", end={"x": 2.0, "v": 0.0})


def test_a_motion_cut_in_two_costs_what_it_costs_in_one() -> None:
    found = solve_once(two_halves())
    assert found.cost == pytest.approx(12 * 2**2 / 2**3, rel=1e-9)
    assert found.phases[0].end == pytest.approx(found.phases[1].start, abs=1e-9)


def test_a_motion_cut_in_two_without_a_linkage_costs_nothing() -> None:
    problem = dataclasses.replace(two_halves(), linkages=())
    assert solve_once(problem).cost == pytest.approx(0.0, abs=1e-9)


def test_a_jump_map_is_met_to_the_solvers_tolerance() -> None:
    found = solve(two_halves(map=lambda x, p: (x[0], -0.5 * x[1])))
    end, start = found.phases[0].end, found.phases[1].start
    assert start == pytest.approx([end[0], -0.5 * end[1]], abs=1e-9)
    assert found.cost > 6.1
    assert found.resimulation is not None
    assert found.resimulation.chain_error < 1e-8  # the chain is simulated through the map as well


def test_an_offset_shifts_only_the_state_that_it_names() -> None:
    found = solve_once(two_halves(offset={"x": 1.0}))
    assert found.phases[1].start - found.phases[0].end == pytest.approx([1.0, 0.0], abs=1e-9)
    assert found.cost == pytest.approx(12 * 1**2 / 2**3, rel=1e-9)


def test_a_map_may_depend_on_static_parameters() -> None:
    shifted = Linkage(0, 1, lambda x, p: (x[0] + p[0], x[1]))
    found = solve_once(Problem(halves(), (shifted,), {"shift": (0.0, 1.5)}))
    assert found.parameters == pytest.approx([1.5], abs=1e-6)
    assert found.cost == pytest.approx(12 * 0.5**2 / 2**3, rel=1e-5)


def spun(turns: int) -> Extremal:
    """A motor that turns a load whole turns in 1 s and ends at the rate at which it began."""
    phase = block("turn", start={"x": 0.0})
    closed = Linkage(0, 0, offset={"x": -2 * math.pi * turns})
    guess = [line(np.zeros(2), np.array([2 * math.pi * turns, 0.0]), np.zeros(1), 1.0)]
    return solve_once(Problem((phase,), (closed,)), guess)


@pytest.mark.parametrize("turns", [1, -2])
def test_a_phase_linked_to_itself_is_periodic_modulo_whole_turns(turns: int) -> None:
    found = spun(turns)
    assert found.succeeded
    assert found.phases[0].end[0] == pytest.approx(2 * math.pi * turns, abs=1e-9)
    assert found.phases[0].start[1] == pytest.approx(2 * math.pi * turns, abs=1e-6)  # coasting
    assert found.phases[0].start[1] == pytest.approx(found.phases[0].end[1], abs=1e-9)
    assert found.cost == pytest.approx(0.0, abs=1e-9)


def test_a_cycle_closes_over_several_phases() -> None:
    there = block("there", start={"x": 0.0}, end={"x": 1.0})
    back = block("back")
    found = solve_once(Problem((there, back), (Linkage(0, 1), Linkage(1, 0))))
    assert found.phases[1].end == pytest.approx(found.phases[0].start, abs=1e-9)
    # By symmetry v = 0 at both ends: twice there and back again costs 2 * 12 m^2 / s^3.
    assert found.cost == pytest.approx(24.0, rel=1e-8)


def test_phases_may_differ_in_states_controls_and_meshes() -> None:
    """A block is pushed for 1 s, then slides with friction, all that is left being its place."""
    push = block("push", start={"x": 0.0, "v": 0.0})
    creep = Phase(
        "creep",
        states=("x",),
        flow=lambda x, u, p: (1.0 - x,),
        end={"x": 1.5},
        duration=1.0,
    )
    problem = Problem((push, creep), (Linkage(0, 1, lambda x, p: x[0]),))
    mesh = Mesh(((0.0, 0.3, 1.0), (0.0, 0.5, 1.0)), ((3, 5), (4, 4)))
    found = solve_once(problem, mesh=mesh)
    needed = 1 + 0.5 * math.e  # x - 1 falls by e
    assert found.phases[1].start == pytest.approx([needed], rel=1e-7)
    assert found.cost == pytest.approx(3 * needed**2, rel=1e-7)  # v is free at the end
    assert found.phases[1].controls.shape[-1] == 0


def test_phases_may_be_given_in_any_order() -> None:
    forward = two_halves()
    backward = Problem(forward.phases[::-1], (Linkage(1, 0),))
    assert solve_once(backward).cost == pytest.approx(solve_once(forward).cost, rel=1e-9)


def test_boundary_constraints_see_all_ends_and_durations() -> None:
    problem = dataclasses.replace(
        two_halves(),
        phases=(
            block("first", start={"x": 0.0, "v": 0.0}, duration=(0.1, 3.0)),
            block("second", end={"x": 2.0, "v": 0.0}, duration=(0.1, 3.0)),
        ),
        duration=2.0,
        boundary=Constraint(
            lambda starts, ends, durations, p: (durations[0] - 3 * durations[1], ends[0][0]),
            np.array([0.0, 1.8]),
            np.array([0.0, math.inf]),
            ("three times as long", "most of the way"),
        ),
    )
    found = solve_once(problem)
    assert found.phases[0].duration == pytest.approx(1.5, abs=1e-8)
    assert found.phases[0].end[0] >= 1.8 - 1e-8
    free = solve_once(dataclasses.replace(problem, boundary=None))
    assert free.cost == pytest.approx(6.0, rel=1e-8)
    assert found.cost > free.cost + 0.1


def test_the_failure_of_a_linkage_names_its_phases_and_states() -> None:
    near = block("near", start={"x": 0.0, "v": 0.0}, bounds={"x": (0.0, 0.5)})
    far = block("far", end={"x": 2.0, "v": 0.0}, bounds={"x": (1.0, 2.0)})
    found = solve_once(Problem((near, far), (Linkage(0, 1),)))
    assert not found.converged
    assert any("linkage of x from 'near' of phase 'far'" in text for text in found.failures)
