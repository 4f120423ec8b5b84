from __future__ import annotations

import numpy as np
import pytest

from rimless_gym.equations import DOUBLE, SINGLE
from trajopt.feedback.joined import NEAR, Joined
from trajopt.feedback.laws import lqr
from trajopt.feedback.orbit import squared_distances


class Recording:
    """A controller of one voltage that keeps what it was asked."""

    def __init__(self, volts: float) -> None:
        self.volts, self.states = volts, []

    def __call__(self, x, mode):
        self.states += list(zip(x[:, 0], mode, strict=True))
        return np.full(len(x), self.volts)


@pytest.fixture
def joined(held):
    asked = lqr.design(held)

    class Asked(Recording):
        params, data = asked.params, asked.data

    return Joined(Asked(1.0), Recording(2.0))


def test_the_law_is_asked_near_its_gait_and_the_catch_far_away_and_in_double_stance(joined, held):
    near, far = held.state(0.3), held.state(0.3) + [0.0, 1.0, 1.0, 1.0]
    x, modes = np.array([near, far, near, far]), np.array([SINGLE, SINGLE, DOUBLE, DOUBLE])
    distances = np.sqrt(squared_distances(x, joined.law.data.orbit))
    assert distances[0] < NEAR < distances[1]
    assert joined(x, modes).tolist() == [1.0, 2.0, 2.0, 2.0]
    assert joined.law.states == [(near[0], SINGLE)]
    assert joined.catch.states == [(far[0], SINGLE), (near[0], DOUBLE), (far[0], DOUBLE)]


def test_one_state_gives_one_voltage_and_who_has_nothing_to_say_is_not_asked(joined, held):
    assert joined(held.state(0.3)) == 1.0
    assert joined.catch.states == []


@pytest.mark.parametrize(
    ("near", "error", "message"),
    [
        (np.nan, ValueError, "near = nan: must be finite"),
        (-1.0, ValueError, "near = -1.0: must be greater than 0"),
        ("a", TypeError, "near = 'a': must be a real number"),
    ],
)
def test_a_distance_that_is_none_is_refused(near, error, message, joined):
    with pytest.raises(error, match=message):
        Joined(joined.law, joined.catch, near)
