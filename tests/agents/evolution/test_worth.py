from __future__ import annotations

import numpy as np
import pytest

from agents.evolution.walks import Duration, Walks
from agents.evolution.worth import Worth, families, members, senses
from agents.pacing import LEAST_SHARE, MULTIPLE, NO_WALK, CleanWalking, paced_price
from rimless_gym import BUILDABLE, Task

DURATION = Duration(1000, 500)
STEP = 2 * BUILDABLE.leg_length * np.sin(np.pi / BUILDABLE.n_legs)


def walks(**changes):
    """One policy from two starts, whirling forward once a step at 0.52 m/s for 10 s."""
    values = {
        "lasted": 1.0,
        "distance": 10 * STEP,
        "energy": 2.5,
        "steps": 10.0,
        "turned": -20 * np.pi,
        "slipping": 0.0,
    } | changes
    return Walks(**{name: np.full((1, 2), value) for name, value in values.items()})


@pytest.fixture
def worth():
    return Worth(BUILDABLE, Task(), speed=0.62)


def earned(worth, family=-1, price=1.0, **changes):
    return worth.of(walks(**changes), DURATION, family, price)[0]


def test_a_walk_earns_its_distance_less_its_energy(worth):
    energy = (2.5 + 5.0 * BUILDABLE.idle_power) / BUILDABLE.weight
    assert earned(worth) == pytest.approx((10 * STEP - energy) / 5.0)


def test_distance_above_the_paid_speed_earns_nothing(worth):
    assert earned(worth, distance=3.1) == pytest.approx(earned(worth, distance=7.0))


def test_distance_in_another_familys_gait_earns_nothing(worth):
    energy = (2.5 + 5.0 * BUILDABLE.idle_power) / BUILDABLE.weight
    assert earned(worth, family=0) == pytest.approx(-energy / 5.0)


def test_falling_and_slipping_cost_what_the_task_says(worth):
    task = Task()
    assert earned(worth) - earned(worth, slipping=5.0) == pytest.approx(
        task.slip_penalty * 0.05 / 5.0
    )
    late, early = (earned(worth) - earned(worth, lasted=lasted) for lasted in (0.999, 0.5))
    assert late == pytest.approx(1.001 * task.fall_penalty / 5.0)
    assert early == pytest.approx(1.5 * task.fall_penalty / 5.0)


def test_only_the_best_starts_are_judged(worth):
    one_falls = walks()
    one_falls.lasted[0, 1] = 0.2
    earned_by = [worth.of(one_falls, DURATION, -1, 1.0, judged)[0] for judged in (0.1, 0.5, 1.0)]
    assert earned_by[0] == earned_by[1] == pytest.approx(earned(worth))
    assert earned_by[2] < 0.7 * earned_by[0]


def test_a_pendulum_that_hardly_turns_has_no_sense():
    several = walks()
    assert senses(several).tolist() == [[-1, -1]]
    several.turned[0] = 4.0, 3.0
    assert senses(several).tolist() == [[1, 0]]
    several.lasted[0, 0] = 0.9
    assert senses(several).tolist() == [[0, 0]]


def test_a_gait_is_that_of_the_walks_by_the_rules_in_its_family(worth):
    gait = worth.gait(walks(), DURATION, -1)
    energy = 2.5 + 5.0 * BUILDABLE.idle_power
    assert gait.share == 1.0
    assert gait.speed == pytest.approx(10 * STEP / 5.0)
    assert gait.cot == pytest.approx(energy / (BUILDABLE.weight * 10 * STEP))
    nothing = NO_WALK
    assert worth.gait(walks(), DURATION, 0) == nothing
    assert worth.gait(walks(slipping=1.0), DURATION, -1) == nothing
    assert worth.gait(walks(lasted=0.9), DURATION, -1) == nothing


def test_families_are_whole_turns_per_step_fewest_first():
    several = Walks(
        *(
            np.concatenate([a, b, c])
            for a, b, c in zip(walks(), walks(turned=0.3), walks(turned=-30 * np.pi), strict=True)
        )
    )
    assert families(several).tolist() == [0, -1]  # one and a half turns belong to no family
    assert members(several, -1).all(axis=1).tolist() == [True, False, False]
    assert families(walks(steps=2.0)).tolist() == []


def test_the_paced_price_follows_the_cost_of_walking_and_never_rises():
    assert paced_price(5.0, CleanWalking(0.9, 0.8, 0.5), 0.5) == MULTIPLE * 0.8
    assert paced_price(1.0, CleanWalking(0.9, 0.8, 0.5), 0.5) == 1.0
    assert paced_price(1.0, CleanWalking(0.9, 0.05, 0.5), 0.5) == 0.5
    assert paced_price(5.0, CleanWalking(LEAST_SHARE - 0.01, 0.8, 0.5), 0.5) == 5.0
    assert paced_price(5.0, NO_WALK, 0.5) == 5.0
    assert paced_price(5.0, CleanWalking(0.9, 0.8, 0.5), 0.5, multiple=3.0) == 3.0 * 0.8
