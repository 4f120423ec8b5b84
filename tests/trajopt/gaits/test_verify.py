"""Verification must see what is wrong with a gait, and measure what is right."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL, hybrid, simulate
from trajopt import Problem, Solution, periodic_gait
from trajopt.gaits.library import index, nearest, repeated
from trajopt.gaits.problem import WheelPhases
from trajopt.gaits.verify import (
    SPARE_TIMES,
    begun,
    playback,
    simulated,
    simulated_stride,
    spans,
    verify,
)

P = THESIS_PHYSICAL
ONE = nearest(P, 0.5, 1)[0].load()
TWO = nearest(P, 0.5, 2)[0].load()


def gait_end(params):
    return Problem((WheelPhases(params).single_stance(),)).phases[0].at_end


def disturbed(volts: float) -> list:
    return [dataclasses.replace(p, controls=p.controls + volts) for p in ONE.phases]


def slowed(factor: float) -> list:
    return [dataclasses.replace(p, edges=p.edges * factor) for p in ONE.phases]


@pytest.mark.parametrize("phases", [disturbed(0.1), slowed(1.002)], ids=["voltage", "time"])
def test_the_energy_audit_measures_the_energy_missing_over_a_stride(phases: list) -> None:
    found = verify(P, phases, ONE.theta_turns)
    run = simulated_stride(P, phases, SPARE_TIMES)
    start, end = (hybrid.mechanical_energy(*x, P.constants) for x in (run.x[0], run.x[-1]))
    assert abs(end - start) > 1e-3
    assert found.energy_audit == pytest.approx(abs(end - start), rel=1e-3)
    assert "the energy balance does not close" in found.failures


def test_states_that_the_simulation_does_not_repeat_fail() -> None:
    off = [dataclasses.replace(p, states=p.states.copy()) for p in ONE.phases]
    middle = len(off[0].states) // 2
    off[0].states[middle, 1, 1] += 1e-4
    found = verify(P, off, ONE.theta_turns)
    assert found.state_error > 1e-5
    assert "re-simulated states differ" in found.failures


def test_a_stride_of_many_steps_is_verified_step_by_step() -> None:
    many, v = repeated(ONE, 4), ONE.verification
    found = verify(P, many.phases, many.theta_turns)
    assert found.passed
    assert found.electrical_positive == pytest.approx(4 * v.electrical_positive, rel=1e-9)
    torn = list(many.phases)
    torn[2] = dataclasses.replace(torn[2], states=torn[2].states + [0.0, 1e-3, 0.0, 0.0])
    assert not verify(P, torn, many.theta_turns).passed  # the joints do not agree


def test_a_step_in_which_deviations_grow_beyond_simulation_is_verified_in_spans() -> None:
    slow = nearest(BUILDABLE, 0.1, 1)[0].load()
    found = verify(BUILDABLE, slow.phases, slow.theta_turns)
    assert found.passed
    assert found.spans > slow.steps
    second = spans(BUILDABLE, slow.phases, slow.theta_turns)[1]
    moved = second.phase.start + [0.0, 1e-4, 0.0, 0.0]
    torn = [begun(slow.phases[0], moved, second.element)]
    assert "re-simulated states differ" in verify(BUILDABLE, torn, slow.theta_turns).failures


@pytest.mark.parametrize("slope", [0.01, pytest.param(-0.01, marks=pytest.mark.slow)])
def test_the_energy_audit_closes_on_a_slope_and_downhill_costs_less(slope: float) -> None:
    sloped = periodic_gait(P.replace(slope=slope), ONE.speed, 1, guess=ONE)
    v, p = sloped.verification, sloped.params
    work = p.weight * math.sin(p.slope) * v.distance
    assert v.energy_audit < 1e-6 < 1e-2 < abs(work)
    assert v.passed
    assert (sloped.cot < ONE.cot) == (slope > 0)


@pytest.mark.parametrize(
    ("limit", "figure", "failure"),
    [
        ("voltage_limit", "peak_voltage", "the voltage limit is exceeded"),
        ("friction", "max_friction_demand", "the stance foot slips"),
    ],
)
def test_verification_names_exactly_the_limit_that_a_gait_exceeds(
    limit: str, figure: str, failure: str
) -> None:
    used = getattr(ONE.verification, figure)
    over = verify(P.replace(**{limit: 0.99 * used}), ONE.phases, ONE.theta_turns)
    assert over.failures == (failure,)


def test_verification_names_a_touchdown_that_slips() -> None:
    friction = 0.99 * ONE.verification.max_impulse_friction_demand
    over = verify(P.replace(friction=friction), ONE.phases, ONE.theta_turns)
    assert "a touchdown slips" in over.failures


def test_verification_fails_on_a_changed_machine() -> None:
    other = P.replace(wheel_mass=1.01 * P.wheel_mass)
    assert not verify(other, ONE.phases, ONE.theta_turns).passed


def test_a_gait_whose_pendulum_enters_the_floor_fails_where_there_is_one() -> None:
    assert ONE.verification.clearance < -0.1
    assert ONE.verification.passed
    floored = P.replace(leg_length=0.682)  # just longer than the pendulum
    found = verify(floored, ONE.phases, ONE.theta_turns)
    assert found.clearance < -0.01
    assert "the pendulum touches the floor" in found.failures


@pytest.mark.parametrize(("length", "reaches_floor"), [(0.14, False), (0.17, True), (0.34, False)])
def test_gaits_may_not_enter_the_floor_where_there_is_one(
    length: float, reaches_floor: bool
) -> None:
    params = P.replace(pendulum_length=length)
    path = Problem((WheelPhases(params).single_stance(),)).phases[0].path

    def violated(theta: float) -> set[str]:
        values = np.asarray(path.function([params.constants.a, theta, 0.0, 0.0], [0.0], []))
        by_name = zip(path.names, path.violation(values.ravel()), strict=True)
        return {name for name, by in by_name if by > 0}

    low, high = violated(0.0), violated(2.0)
    assert [("pendulum's clearance" in names) for names in (low, high)] == [reaches_floor, False]


@pytest.mark.parametrize(("friction", "slope"), [(0.45, 0.0), (0.52, 0.05), (0.6, 0.0)])
def test_a_phase_may_end_only_where_friction_holds_the_touchdown(
    friction: float, slope: float
) -> None:
    params = P.replace(friction=friction, slope=slope)
    p, end = params.constants, gait_end(params)
    rng, outcomes = np.random.default_rng(0), []
    for _ in range(400):
        before = np.array([p.b, *rng.uniform([-math.pi, 0.0, -10.0], [math.pi, 5.0, 10.0])])
        _, phi, dphi, dtheta, _, _ = hybrid.after_touchdown(1, *before[1:], 0.0, p)
        after = np.array([phi, before[1], dphi, dtheta])
        jx, jy = np.subtract(hybrid.linear_momentum(*after, p), hybrid.linear_momentum(*before, p))
        if dphi < 0.02 or abs(abs(jx) - friction * jy) < 1e-6:
            continue
        holds = jy > 0 and abs(jx) <= friction * jy
        values = np.asarray(end.function(before, [])).ravel()
        assert (end.violation(values).max() == 0) == holds
        outcomes.append(holds)
    assert 10 < sum(outcomes) < len(outcomes) - 10


# -- forward simulation ---------------------------------------------------------------------------


def test_an_independent_simulation_follows_the_gait_over_the_whole_stride(gait: Solution) -> None:
    breakpoints, volts = playback(gait.phases)
    run = simulate(
        gait.params,
        gait.state(0.0),
        volts,
        gait.duration,
        breakpoints=breakpoints,
        rtol=1e-9,  # far below what is asked for; finer, it takes much longer
        atol=1e-10,
    )
    t = np.linspace(0, gait.duration, 301)[1:-1]
    # Where the voltage jumps, rounding decides which one acts: nothing is compared there.
    jumps = np.concatenate([gait.phase_times, gait.breakpoints])
    t = t[np.abs(t[:, None] - jumps).min(axis=1) > 1e-6]
    assert len(t) > 250
    assert np.abs(run.state(t) - gait.state(t)).max() < 1e-6
    np.testing.assert_allclose([volts(time, None) for time in t], gait.control(t), atol=1e-9)


def test_phases_of_different_control_degrees_are_played_one_after_the_other() -> None:
    first, second = TWO.phases
    volts = np.linspace(0.0, 3.0, len(second.controls))[:, None, None]  # constant in each element
    second = dataclasses.replace(
        second, control_nodes=np.array([0.0, 1.0]), controls=np.repeat(volts, 2, axis=1)
    )
    breakpoints, law = playback([first, second])
    assert breakpoints[-1] == pytest.approx(TWO.duration)
    assert len(breakpoints) == len(first.controls) + len(second.controls)
    for begin, phase in ((0.0, first), (first.duration, second)):
        for middle in 0.5 * (phase.edges[1:] + phase.edges[:-1]):
            expected = phase.control(middle)[0, 0]
            assert law(begin + middle, None) == pytest.approx(expected, abs=1e-9)


def test_a_stride_is_simulated_just_far_enough_for_the_last_touchdown() -> None:
    early, late, later = -1e-6, 1e-6, 1e-3
    assert simulated(TWO.params, TWO.phases, TWO.duration + early).steps == 1
    run = simulated_stride(TWO.params, TWO.phases, (early, late, later))
    assert run.steps == 2
    assert run.t[-1] == pytest.approx(TWO.duration + late, abs=1e-12)


def test_around_a_touchdown_the_state_shows_which_steps_voltage_acts() -> None:
    first, second = TWO.phases
    _, law = playback(TWO.phases)
    before, after = first.end, second.start
    last, next_ = first.control([first.duration], "left")[0, 0], second.control(0.0)[0, 0]
    assert last != pytest.approx(next_)
    for t in (first.duration - 1e-9, first.duration + 1e-9):
        assert law(t, before) == pytest.approx(last, abs=1e-5)
        assert law(t, after) == pytest.approx(next_, abs=1e-5)
    assert law(first.duration + 1e-4, before) == law(first.duration + 1e-4, None)


def test_after_the_last_touchdown_the_next_strides_voltage_acts() -> None:
    gaits = (entry.load() for entry in index() if entry.steps == 2)
    gait = next(g for g in gaits if abs(g.control(0.0) - g.control(g.duration, "left")) > 1.0)
    run = simulated_stride(gait.params, gait.phases, [1e-6])
    assert run.t[-1] > run.touchdowns[-1].time
    assert run.u[-1] == pytest.approx(gait.control(0.0), abs=1e-3)
