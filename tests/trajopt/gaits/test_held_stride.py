"""How many control intervals a stride lasts, and what clocks are refused."""

from __future__ import annotations

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from trajopt.gaits.held_stride import held_speed, held_speeds, ticks_of_stride

P = THESIS_PHYSICAL


@pytest.mark.parametrize("speed", [0.2, 0.3, 0.5, 0.57, 0.6])
@pytest.mark.parametrize("steps", [1, 2, 3])
def test_no_other_whole_number_of_intervals_gives_a_speed_nearer_to_the_wanted_one(speed, steps):
    ticks = ticks_of_stride(P, speed, steps, 0.01)
    speeds = [steps * P.step_length / (n * 0.01) for n in (ticks - 1, ticks, ticks + 1)]
    off = [abs(each - speed) for each in speeds]
    assert off[1] == min(off)
    assert held_speed(P, speed, steps, 0.01) == pytest.approx(speeds[1], rel=1e-15)


def test_one_step_at_half_a_metre_per_second_lasts_88_intervals():
    assert ticks_of_stride(P, 0.5, 1, 0.01) == 88


def test_more_steps_in_a_stride_give_speeds_in_between():
    apart = [0.505 - held_speed(P, 0.505, steps, 0.01) for steps in (1, 2, 3)]
    assert abs(apart[1]) < abs(apart[0])
    assert abs(apart[2]) < abs(apart[0])


@pytest.mark.parametrize("hold", [0, -0.01, float("nan"), float("inf")])
def test_a_hold_that_is_no_duration_is_refused(hold):
    with pytest.raises(ValueError, match="hold = "):
        ticks_of_stride(P, 0.5, 1, hold)


def test_a_hold_that_is_no_number_is_refused():
    with pytest.raises(TypeError, match=r"hold = '0\.01'"):
        ticks_of_stride(P, 0.5, 1, "0.01")


@pytest.mark.parametrize(
    ("speed", "steps", "hold", "told"),
    [
        (0.5, 1, 0.0005, "at least 0.001 s; leave it out"),
        (0.5, 1, 2.0, "at most 0.588 s at 0.5 m/s.*ask for at most 0.147 m/s"),
        (30.0, 1, 0.01, "two control intervals"),
        (0.05, 3, 0.001, "at most 3000 control intervals.*fewer steps or a higher speed"),
    ],
)
def test_clocks_that_are_too_fast_or_too_slow_are_refused(speed, steps, hold, told):
    with pytest.raises(ValueError, match=f"hold = {hold}: must be .*{told}"):
        ticks_of_stride(P, speed, steps, hold)


def test_the_longest_hold_that_a_message_names_is_accepted():
    with pytest.raises(ValueError, match="at most") as refused:
        ticks_of_stride(P, 0.5, 1, 2.0)
    longest = float(str(refused.value).split("at most ")[1].split(" s")[0])
    assert ticks_of_stride(P, 0.5, 1, 0.999 * longest) == 2


def test_held_speeds_are_all_that_a_clock_allows_between_two() -> None:
    speeds = held_speeds(P, 0.45, 0.55, 0.01)
    assert speeds[0] == held_speed(P, 0.45, 1, 0.01)
    assert speeds[-1] == held_speed(P, 0.55, 1, 0.01)
    ticks = [P.step_length / speed / 0.01 for speed in speeds]
    assert np.diff(ticks) == pytest.approx(-1.0)
