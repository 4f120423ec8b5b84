"""Verification must see what is wrong with a gait, and measure what is right."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL, hybrid, simulate
from trajopt import Problem, Solution, periodic_gait
from trajopt.gaits.library import nearest
from trajopt.gaits.problem import WheelPhases
from trajopt.gaits.verify import SPARE_TIMES, simulated_stride, verify

P = THESIS_PHYSICAL
ONE = nearest(P, 0.5, 1)[0]


def gait_end(params):
    return Problem((WheelPhases(params).single_stance(),)).phases[0].at_end


def disturbed(volts: float) -> list:
    return [dataclasses.replace(p, controls=p.controls + volts) for p in ONE.phases]


def slowed(factor: float) -> list:
    return [dataclasses.replace(p, edges=p.edges * factor) for p in ONE.phases]


@pytest.fixture(scope="module", params=[0.01, -0.01], ids=["downhill", "uphill"])
def sloped(request: pytest.FixtureRequest) -> Solution:
    return periodic_gait(P.replace(slope=request.param), ONE.speed, 1, guess=ONE)


@pytest.mark.parametrize("phases", [disturbed(0.1), slowed(1.002)], ids=["voltage", "time"])
def test_the_energy_audit_measures_the_energy_missing_over_a_stride(phases: list) -> None:
    found = verify(P, phases, ONE.theta_turns)
    run = simulated_stride(P, phases, SPARE_TIMES)
    start, end = (hybrid.mechanical_energy(*x, P.constants) for x in (run.x[0], run.x[-1]))
    assert abs(end - start) > 1e-3
    assert found.energy_audit == pytest.approx(abs(end - start), rel=1e-3)
    assert "the energy balance does not close" in found.failures


def test_the_energy_audit_closes_on_a_slope(sloped: Solution) -> None:
    v, p = sloped.verification, sloped.params
    work = p.weight * math.sin(p.slope) * v.distance
    assert v.energy_audit < 1e-6 < 1e-2 < abs(work)
    assert v.passed


def test_downhill_is_cheaper_than_uphill(sloped: Solution) -> None:
    assert (sloped.cot < ONE.cot) == (sloped.params.slope > 0)


def test_the_cost_at_a_hundred_hertz_hold_is_that_of_a_simulation_with_held_voltages() -> None:
    costs = []
    for gait in (ONE, nearest(P, 0.6, 1)[0]):
        ticks = 0.01 * np.arange(math.ceil(gait.duration / 0.01))
        run = simulate(P, gait.state(0.0), gait.control(ticks + 1e-9), gait.duration)
        found = verify(P, gait.phases, gait.theta_turns)
        assert found.passed
        assert found.hold_failure == ""
        assert found.cot_at_100hz_hold == pytest.approx(run.ledger.cost_of_transport(P), rel=1e-6)
        costs.append(found.cot_at_100hz_hold)
    assert np.ptp(costs) > 1e-3


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
    low, high = ([params.constants.a, theta, 0.0, 0.0] for theta in (0.0, 2.0))
    refused = [
        {
            name
            for name, by in zip(
                path.names,
                path.violation(np.asarray(path.function(x, [0.0], [])).ravel()),
                strict=True,
            )
            if by > 0
        }
        for x in (low, high)
    ]
    assert [("pendulum's clearance" in names) for names in refused] == [reaches_floor, False]


@pytest.mark.parametrize("friction", [0.45, 0.52, 0.6])
@pytest.mark.parametrize("slope", [0.0, 0.05])
def test_a_phase_may_end_only_where_friction_holds_the_touchdown(
    friction: float, slope: float
) -> None:
    params = P.replace(friction=friction, slope=slope)
    p, end = params.constants, gait_end(params)
    rng, verdicts = np.random.default_rng(0), []
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
        verdicts.append(holds)
    assert 10 < sum(verdicts) < len(verdicts) - 10
