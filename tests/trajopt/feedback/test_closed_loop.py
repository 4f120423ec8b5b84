from __future__ import annotations

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import advance, hybrid_states
from trajopt.feedback.closed_loop import multipliers
from trajopt.feedback.laws import input_output, lqr
from trajopt.feedback.orbit import squared_distances

STRIDES = 5


@pytest.mark.parametrize("law", [input_output, lqr], ids=["input_output", "lqr"])
def test_small_deviations_decay_by_the_largest_multiplier_in_a_stride(law, held):
    designed = law.design(held)
    ticks, orbit = round(held.duration / 0.01), designed.data.orbit
    ways = np.random.default_rng(0).normal(size=(16, 4))
    on = np.tile(held.state(held.first_tick), (16, 1))
    x = hybrid_states(on + 3e-3 * ways / np.sqrt(orbit.metric), SINGLE)
    sizes = []
    for tick in range(STRIDES * ticks + 1):
        if tick % ticks == 0:
            squares = squared_distances(np.ascontiguousarray(x[:, :4]), orbit)
            sizes.append(np.sqrt(np.mean(squares)))
        advance(THESIS_PHYSICAL, x, designed(x[:, :4]))
    measured = (sizes[3] / sizes[1]) ** 0.5
    assert measured == pytest.approx(multipliers(designed, held)[0], rel=0.2)
