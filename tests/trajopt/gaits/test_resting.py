"""Where a wheel should rather walk faster and rest in between."""

from __future__ import annotations

import pytest

from trajopt.gaits.fronts import CotFront, rests
from trajopt.gaits.library import shipped

WEIGHT, IDLE = 20.0, 0.5


def test_resting_costs_the_energy_of_walking_and_the_idle_power_of_the_rest() -> None:
    slow, _ = rests([0.2, 0.6], [0.4, 0.1], WEIGHT, IDLE)
    assert slow is not None
    assert (slow.speed, slow.walking) == (0.2, 0.6)
    assert slow.share == pytest.approx(1 / 3)
    # In 3 s the wheel goes 0.6 m: 1 s of walking, 2 s of rest.
    walking = 0.1 * WEIGHT * 0.6
    assert slow.cot == pytest.approx((walking + 2.0 * IDLE) / (WEIGHT * 0.6))


def test_at_the_fastest_speed_there_is_nothing_faster_to_rest_from() -> None:
    assert rests([0.2, 0.6], [0.4, 0.1], WEIGHT, IDLE)[-1] is None


def test_resting_does_not_pay_where_walking_slowly_is_cheaper_than_idling() -> None:
    assert rests([0.2, 0.6], [0.12, 0.1], WEIGHT, IDLE)[0] is None
    assert rests([0.2, 0.6], [0.12, 0.1], WEIGHT, 0.0)[0] is not None


def test_resting_does_not_pay_on_a_front_whose_power_is_convex() -> None:
    speeds = [0.1, 0.2, 0.3, 0.4]
    cots = [(IDLE + 40.0 * v * v) / (WEIGHT * v) for v in speeds]
    assert rests(speeds, cots, WEIGHT, IDLE) == (None,) * 4


def test_the_best_of_several_faster_speeds_is_taken() -> None:
    first, second, last = rests([0.2, 0.3, 0.6], [0.5, 0.1, 0.3], WEIGHT, 0.0)
    assert first is not None
    assert first.walking == 0.3
    assert second is None
    assert last is None


def test_speeds_must_ascend_and_match_their_costs() -> None:
    with pytest.raises(ValueError, match="must be greater than 0 and ascend"):
        rests([0.3, 0.2], [0.1, 0.1], WEIGHT, IDLE)
    with pytest.raises(ValueError, match="equally long"):
        rests([0.2, 0.3], [0.1], WEIGHT, IDLE)


def test_a_front_tells_where_its_machine_should_rest() -> None:
    front = CotFront(shipped())
    marked = front.rests
    assert len(marked) == len(front.envelope)
    for gait, rest in zip(front.envelope, marked, strict=True):
        if rest is not None:
            assert rest.cot < gait.cot
            assert rest.walking > gait.speed
