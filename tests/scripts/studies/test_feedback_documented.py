"""Figures in the text of docs/feedback.md that its tables do not have."""

from __future__ import annotations

import numpy as np
import pytest

from agents.evaluate import SHORT_PROTOCOL, evaluate
from agents.rollout import controller_policy
from rimless_gym.presets import preset
from scripts.studies.feedback_laws.measures import on_the_gait
from trajopt import Solution, periodic_gait
from trajopt.feedback.laws import lqr, pid, sliding_mode
from trajopt.feedback.orbit import FINENESS, Grid
from trajopt.feedback.transverse import multipliers, riccati, transverse_dynamics

pytestmark = pytest.mark.slow

GAITS = [
    *(("BUILDABLE", speed) for speed in (0.45, 0.5, 0.56, 0.605)),
    *(("THESIS_PHYSICAL", speed) for speed in (0.5, 0.57)),
]


def gait(machine: str, speed: float) -> Solution:
    return periodic_gait(preset(machine), speed, hold=0.01)


@pytest.mark.parametrize(("machine", "speed"), GAITS)
def test_the_servo_holds_every_gait_in_theory(machine, speed):
    solution = gait(machine, speed)
    assert multipliers(pid.design(solution), solution)[0] <= 0.815


def test_the_scale_of_the_sliding_mode_asks_for_what_the_page_says():
    solution = gait("THESIS_PHYSICAL", 0.57)
    transverse = transverse_dynamics(Grid.of(solution))
    later, now, _ = riccati(transverse, sliding_mode.EFFORT, sliding_mode.AHEAD)
    per_volt = np.einsum("ji,ji->j", np.roll(now, -FINENESS, axis=0), transverse.B[:, :, 0])
    share = 1.0 - sliding_mode.SWITCHING_GAIN / sliding_mode.LAYER
    most = [
        np.abs(transverse.per_deviation(share * each_now - each_later)[:, 0]).max()
        for each_now, each_later in (
            (now, later),
            (now / np.roll(per_volt, FINENESS)[:, None], later / per_volt[:, None]),
        )
    ]
    assert most == pytest.approx([900.0, 2700.0], rel=0.03)


def walk_of_the_lqr(solution, ahead):
    starts = on_the_gait(solution, 16)
    policy = controller_policy(solution.params, lqr.design(solution, ahead=ahead))
    return evaluate(policy, solution.params, SHORT_PROTOCOL, starts=starts)


@pytest.mark.parametrize(
    ("machine", "speed", "with_clock", "without"),
    [
        ("THESIS_PHYSICAL", 0.5, 0.0013, 0.011),
        ("BUILDABLE", 0.5, 0.0, 0.002),
        ("BUILDABLE", 0.605, 0.0, 0.002),
    ],
)
def test_the_clocks_gain_is_worth_what_the_page_says(machine, speed, with_clock, without):
    solution = gait(machine, speed)
    for ahead, over in ((lqr.AHEAD, with_clock), (None, without)):
        cot = walk_of_the_lqr(solution, ahead).cot
        assert cot / solution.cot - 1.0 == pytest.approx(over, abs=6e-4)


def test_without_the_clock_the_fastest_gait_slips_as_the_page_says():
    solution = gait("THESIS_PHYSICAL", 0.57)
    kept, slipping = (walk_of_the_lqr(solution, ahead) for ahead in (lqr.AHEAD, None))
    assert kept.cot / solution.cot - 1.0 == pytest.approx(0.0028, abs=6e-4)
    assert slipping.failures == {"slips": 16}
    assert slipping.friction_demand == pytest.approx(1.006, abs=6e-4)
