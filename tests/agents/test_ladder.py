"""One expert for many commanded speeds."""

import numpy as np
import pytest

from agents.conditions import Conditions
from agents.ladder import Ladder, ladder_of_laws
from agents.rollout import Rollout, draw_starts
from rimless_gym import BUILDABLE


def constant(value):
    return lambda states, observations: np.full(len(states), value)


def test_the_rung_nearest_to_the_command_acts():
    ladder = Ladder(np.array([0.4, 0.5, 0.6]), tuple(map(constant, (0.1, 0.2, 0.3))))
    observations = np.zeros((5, 8), dtype=np.float32)
    observations[:, 6] = (np.array([0.3, 0.44, 0.46, 0.56, 0.9]) - 0.45) / 0.2
    actions = ladder(np.zeros((5, 6)), observations)
    np.testing.assert_array_equal(actions, [0.1, 0.1, 0.2, 0.3, 0.3])


@pytest.mark.parametrize(("speeds", "rungs"), [([], 0), ([0.5], 2), ([0.4, 0.5], 1)])
def test_a_ladder_has_one_policy_for_each_speed(speeds, rungs):
    with pytest.raises(ValueError, match="one for each"):
        Ladder(np.array(speeds), tuple(map(constant, range(rungs))))


@pytest.mark.slow
def test_the_laws_of_a_ladder_walk_at_the_commanded_speed():
    conditions = Conditions.of(BUILDABLE, None, None, (0.566, 0.566), 0.01)
    ladder = ladder_of_laws("lqr", conditions, [1])
    assert len(ladder.speeds) == 1
    starts = draw_starts(BUILDABLE, 6, 0)
    distance = np.zeros(6)
    for k, interval in enumerate(Rollout(conditions, ladder, starts, 1600, command=0.566)):
        if k >= 1000:
            distance[interval.running] += interval.info["distance"]
    assert distance / 6.0 == pytest.approx(ladder.speeds[0], rel=0.02)
