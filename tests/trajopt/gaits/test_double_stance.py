"""Gaits that stop on two feet once in a stride."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rimless_gym import BUILDABLE
from trajopt import Solution, periodic_gait
from trajopt.feedback import laws
from trajopt.gaits.library import warm_starts
from trajopt.gaits.problem import STANDING, gait_problem
from trajopt.gaits.verify import simulated_stride, verify

#: A short stop after every step of the fastest gait that lands softly.
SPEED = 0.59


@pytest.fixture(scope="module")
def gait() -> Solution:
    fast = next(g for g in warm_starts(BUILDABLE, 0.6375, 1) if g.theta_turns == -1)
    return periodic_gait(BUILDABLE, SPEED, 1, double_stance=True, guess=fast)


@pytest.mark.slow
def test_a_gait_stops_and_lifts_off_and_is_verified(gait: Solution) -> None:
    assert gait.verification.passed, gait.report()
    assert gait.double_stance
    assert gait.steps == 1
    assert gait.speed == pytest.approx(SPEED)
    assert "on two feet" in gait.report()


@pytest.mark.slow
def test_the_simulator_passes_through_the_same_modes(gait: Solution) -> None:
    run = simulated_stride(BUILDABLE, gait.phases, [1e-6])
    assert [(e.kind, e.mode) for e in run.events] == [
        ("touchdown", "double_stance"),
        ("lift_off", "single_stance"),
    ]
    assert [e.time for e in run.events] == pytest.approx(gait.phase_times[1:], abs=1e-6)


@pytest.mark.slow
def test_the_foot_moves_at_the_touchdown_and_not_at_the_lift_off(gait: Solution) -> None:
    lands, lifts = gait.phase_times[1:]
    times = [0.5 * lands, 0.5 * (lands + lifts), lifts + 0.5 * lands]
    assert gait.foot(times).tolist() == [0, 1, 1]
    standing = gait.state(0.5 * (lands + lifts))
    assert standing[[0, 2]] == pytest.approx([BUILDABLE.constants.a, 0.0], abs=1e-12)


@pytest.mark.slow
def test_what_stands_follows_from_the_file(gait: Solution, tmp_path: Path) -> None:
    gait.save(tmp_path / "gait.npz")
    again = Solution.load(tmp_path / "gait.npz")
    assert again.double_stance
    assert np.array_equal(again.phase_times, gait.phase_times)
    assert verify(again.params, again.phases, again.theta_turns) == gait.verification


def test_the_problem_has_a_phase_on_two_feet_after_the_last_step() -> None:
    problem = gait_problem(BUILDABLE, speed=0.3, steps=3, double_stance=True)
    assert [phase.name == STANDING for phase in problem.phases] == [False, False, False, True]
    assert problem.duration == pytest.approx(3 * BUILDABLE.step_length / 0.3)


@pytest.mark.slow
def test_feedback_laws_refuse_a_gait_that_stops(gait: Solution) -> None:
    with pytest.raises(ValueError, match="stops on two feet"):
        laws.holding("lqr", gait)


def test_a_clock_and_random_starts_are_refused() -> None:
    with pytest.raises(ValueError, match="leave both out"):
        periodic_gait(BUILDABLE, 0.5, double_stance=True, hold=0.01)
