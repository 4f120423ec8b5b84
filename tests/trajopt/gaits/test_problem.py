"""The wheel's problems: across modes, and with a known answer."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL, simulate
from rimless_gym.symbolic import Design, HybridModel
from tests.trajopt.ocp.problems import passive_wheel, passive_wheel_rate
from trajopt import Extremal, Mesh, Phase, Problem, solve
from trajopt.gaits.library import nearest
from trajopt.gaits.problem import (
    CONTROL_DEGREE,
    WheelPhases,
)
from trajopt.gaits.verify import playback
from trajopt.ocp.guesses import polyline

P = THESIS_PHYSICAL
A = P.constants.a
WHEEL = WheelPhases(P, regeneration=True)  # whose optima are quick to find
REST = {"phi": A, "theta": 0.0, "phi'": 0.0, "theta'": 0.0}


def standing(name: str, **limits: Any) -> Phase:
    return dataclasses.replace(WHEEL.double_stance(name), duration=(0.05, 3.0), **limits)


def first_step() -> Problem:
    """From rest on two feet over one step and half of the next one."""
    step, half = WHEEL.single_stance("step"), WHEEL.single_stance("half a step")
    return Problem(
        phases=(
            standing("push off", start=REST),
            dataclasses.replace(step, start={"phi": A, "phi'": 0.0}, duration=(0.1, 3.0)),
            dataclasses.replace(half, at_end=None, end={"phi": math.pi / 2}, duration=(0.1, 3.0)),
        ),
        linkages=(WHEEL.lift_off(0, 1), WHEEL.touchdown(1, 2)),
        duration=(0.5, 2.5),
    )


def from_rest_to_rest() -> Problem:
    step = WHEEL.last_stance("step")
    return Problem(
        phases=(
            standing("push off", start=REST),
            dataclasses.replace(step, start={"phi": A, "phi'": 0.0}, duration=(0.1, 3.0)),
            standing("come to rest", end=REST),
        ),
        linkages=(WHEEL.lift_off(0, 1), WHEEL.stop(1, 2)),
        duration=(0.5, 4.0),
    )


def swings(amplitudes: tuple[float, ...], travels: tuple[float, ...]) -> list:
    guess = []
    for amplitude, travel, T in zip(amplitudes, travels, (0.6, 0.8, 0.6), strict=True):
        t = np.linspace(0.0, T, 21)
        theta = amplitude * np.sin(math.pi * t / T)
        phi = A + travel * P.constants.alpha * t / T
        rates = np.gradient(phi, t), np.gradient(theta, t)
        guess.append(polyline(t, np.stack([phi, theta, *rates], axis=1)))
    return guess


def solved(problem: Problem, amplitudes: tuple[float, ...], *travels: float) -> Extremal:
    mesh = Mesh.uniform(problem, 8, 5, control_degree=CONTROL_DEGREE)
    return solve(problem, swings(amplitudes, travels), mesh)


@pytest.fixture(scope="module")
def one_step() -> Extremal:
    return solved(first_step(), (1.38, 0.57, 2.09), 0.0, 1.0, 0.5)


def test_a_step_from_rest_converges(one_step: Extremal) -> None:
    assert one_step.converged, one_step.report()
    assert one_step.resimulation.chain_error < 1e-5


def test_the_reference_simulator_lifts_off_and_touches_down_where_the_solution_does(
    one_step: Extremal,
) -> None:
    ends = np.cumsum([phase.duration for phase in one_step.phases])
    knots, volts = playback(one_step.phases)
    run = simulate(
        P,
        one_step.state(0.0),
        lambda t, x: volts(t, None),
        one_step.duration,
        mode="double_stance",
        breakpoints=knots,
    )
    kinds = [(event.kind, event.direction) for event in run.events]
    assert kinds == [("lift_off", 1), ("touchdown", 1)]
    assert [event.time for event in run.events] == pytest.approx(ends[:2].tolist(), abs=1e-5)
    assert run.x[-1] == pytest.approx(one_step.phases[-1].end, abs=1e-4)
    assert run.ledger.energy_with_regeneration == pytest.approx(one_step.cost, rel=1e-4)


@pytest.mark.slow
def test_a_step_from_rest_to_rest_arrives_so_slowly_that_nothing_collides() -> None:
    found = solved(from_rest_to_rest(), (-0.35, 0.43, 1.19), 0.0, 1.0, 0.0)
    assert found.converged, found.report()
    lost = P.constants.Je1 * found.phases[1].end[2] ** 2
    assert 0.0 < lost < 1e-6
    assert found.phases[2].end == pytest.approx([A, 0.0, 0.0, 0.0], abs=1e-9)


def test_both_feet_press_while_the_wheel_stands(one_step: Extremal) -> None:
    guards = HybridModel(P).functions["lift_off_guards"]
    phase = one_step.phases[0]
    t = np.linspace(0.0, phase.duration, 400)[:-1]
    leading, trailing = np.asarray(guards.map(len(t))(phase.state(t).T, phase.control(t).T))
    assert leading.max() < -1.0
    assert trailing.min() > 1.0


def test_a_design_variable_is_the_field_that_it_stands_for() -> None:
    heavier = HybridModel(P.replace(pendulum_mass=3.0, gear_ratio=400.0)).functions
    chosen = HybridModel(P, Design.of("pendulum_mass", "gear_ratio")).functions
    x, u, p = [1.2, 0.4, 1.0, -2.0], 7.0, [3.0, 400.0]
    for name in heavier:
        inputs = [x, u][: heavier[name].n_in()]
        wanted, found = heavier[name](*inputs), chosen[name](*inputs, p)
        assert np.asarray(found) == pytest.approx(np.asarray(wanted), rel=1e-13, abs=1e-13), name


@pytest.mark.slow
def test_a_heavier_pendulum_is_found_where_it_costs_less() -> None:
    wheel = WheelPhases(P, Design.of("pendulum_mass"))
    step = dataclasses.replace(wheel.single_stance(), duration=P.step_length / 0.58)
    ring = Problem((step,), (wheel.touchdown(0, 0, -1),), parameters={"pendulum_mass": 2.22})
    gait = nearest(P, 0.58, 1)[0].load()
    mesh = Mesh.uniform(ring, 14, 6, control_degree=CONTROL_DEGREE)
    fixed = solve(ring, gait.phases, mesh, verify=False, mu_init=1e-3)
    free = dataclasses.replace(ring, parameters={"pendulum_mass": (2.0, 2.5)})
    chosen = solve(free, fixed.phases, mesh, parameters=[2.22], verify=False, mu_init=1e-3)
    assert fixed.succeeded
    assert chosen.succeeded
    assert chosen.cost < fixed.cost - 1e-3
    assert 2.0 <= chosen.parameters[0] <= 2.5


# -- the passive wheel, whose cycle is known ------------------------------------------------------


@pytest.mark.parametrize(("legs", "slope"), [(6, 0.25), (10, 0.06)])
def test_the_passive_cycle_is_found_whatever_the_number_of_legs(legs: int, slope: float) -> None:
    problem = passive_wheel(legs, slope)
    found = solve(problem)
    assert found.converged, found.report()
    assert found.cost == pytest.approx(passive_wheel_rate(legs, slope), rel=1e-7)
    assert found.transcribed_cost == pytest.approx(passive_wheel_rate(legs, slope), rel=1e-7)
    touchdown = problem.linkages[0].map
    after = np.asarray(touchdown(found.phases[0].end, [])).ravel()
    assert after == pytest.approx(found.phases[0].start, abs=1e-9)


@pytest.mark.parametrize(
    ("scheme", "tolerance", "accuracy"),
    [("hermite-simpson", 1e-7, 2e-5), ("trapezoid", 1e-5, 3e-3)],
)
def test_other_schemes_find_the_passive_cycle_as_accurately_as_their_order_allows(
    scheme: str, tolerance: float, accuracy: float
) -> None:
    problem = passive_wheel()
    found = solve(problem, mesh=Mesh.uniform(problem, 10, scheme=scheme), tolerance=tolerance)
    assert found.attempts[-1].succeeded
    assert found.cost == pytest.approx(passive_wheel_rate(), rel=accuracy)


def test_a_smooth_motion_is_refined_by_degree_alone() -> None:
    problem = passive_wheel()
    found = solve(problem, mesh=Mesh.uniform(problem, 4, 3))
    assert found.converged
    assert found.mesh.elements == 4
    assert max(found.mesh.degrees[0]) > 3
