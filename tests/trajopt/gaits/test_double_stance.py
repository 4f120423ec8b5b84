"""Gaits that stop on two feet once in a stride."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL
from trajopt import Solution, periodic_gait
from trajopt.feedback import laws
from trajopt.gaits.library import index, warm_starts
from trajopt.gaits.problem import STANDING, gait_problem
from trajopt.gaits.verify import simulated_stride, verify


@pytest.fixture(scope="module")
def gait() -> Solution:
    return warm_starts(THESIS_PHYSICAL, 0.56, 2, double_stance=True)[0]


def test_a_gait_that_stops_is_verified_again(gait: Solution) -> None:
    assert gait.double_stance
    assert gait.steps == 2
    assert "on two feet" in gait.report()
    again = verify(gait.params, gait.phases, gait.theta_turns)
    assert again.passed
    assert again.electrical_positive == pytest.approx(gait.verification.electrical_positive)


def test_the_friction_cone_binds_the_impulse_of_a_stop_that_slides(gait: Solution) -> None:
    ice = verify(gait.params.replace(friction=1e-4), gait.phases, gait.theta_turns)
    walked = gait.verification.max_impulse_friction_demand
    assert ice.max_impulse_friction_demand > 1.5 * walked


def test_the_simulator_passes_through_the_same_modes(gait: Solution) -> None:
    run = simulated_stride(gait.params, gait.phases, [1e-6])
    assert [(event.kind, event.mode) for event in run.events] == [
        ("touchdown", "single_stance"),
        ("touchdown", "double_stance"),
        ("lift_off", "single_stance"),
    ]
    assert [event.time for event in run.events] == pytest.approx(gait.phase_times[1:], abs=1e-5)


def test_the_foot_moves_at_the_touchdown_and_not_at_the_lift_off(gait: Solution) -> None:
    middles = 0.5 * (gait.phase_times[1:] + gait.phase_times[:-1])
    assert gait.foot([*middles, gait.duration + middles[0]]).tolist() == [0, 1, 2, 2]
    standing = gait.state(middles[-1])
    assert standing[[0, 2]] == pytest.approx([gait.params.constants.a, 0.0], abs=1e-12)


def test_what_stands_follows_from_the_file(gait: Solution, tmp_path: Path) -> None:
    gait.save(tmp_path / "gait.npz")
    again = Solution.load(tmp_path / "gait.npz")
    assert again.double_stance
    assert np.array_equal(again.phase_times, gait.phase_times)


def test_searches_for_other_gaits_do_not_start_from_one_that_stops() -> None:
    assert any(entry.double_stance for entry in index())
    assert not any(gait.double_stance for gait in warm_starts(THESIS_PHYSICAL, 0.56, 2))


def test_the_problem_has_a_phase_on_two_feet_after_the_last_step() -> None:
    problem = gait_problem(BUILDABLE, speed=0.3, steps=3, double_stance=True)
    assert [phase.name == STANDING for phase in problem.phases] == [False, False, False, True]
    assert problem.duration == pytest.approx(3 * BUILDABLE.step_length / 0.3)


def test_feedback_laws_refuse_a_gait_that_stops(gait: Solution) -> None:
    with pytest.raises(ValueError, match="stops on two feet"):
        laws.holding("lqr", gait)


def test_a_clock_and_random_starts_are_refused() -> None:
    with pytest.raises(ValueError, match="leave both out"):
        periodic_gait(BUILDABLE, 0.5, double_stance=True, hold=0.01)


@pytest.mark.slow
def test_a_short_stop_is_added_to_a_gait_that_lands_softly() -> None:
    fast = next(g for g in warm_starts(BUILDABLE, 0.6375, 1) if g.theta_turns == -1)
    gait = periodic_gait(BUILDABLE, 0.59, 1, double_stance=True, guess=fast)
    assert gait.verification.passed, gait.report()
    assert gait.speed == pytest.approx(0.59)
    assert gait.double_stance
