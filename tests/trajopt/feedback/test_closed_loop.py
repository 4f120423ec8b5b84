from __future__ import annotations

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import advance, hybrid_states
from trajopt.feedback.closed_loop import multipliers
from trajopt.feedback.laws import input_output, lqr
from trajopt.feedback.orbit import FINENESS, Grid
from trajopt.feedback.transverse import transverse_dynamics

STRIDES = 4


@pytest.mark.parametrize("design", [input_output.design, lqr.design], ids=["input_output", "lqr"])
def test_a_deviation_of_wheels_kept_in_step_decays_by_the_largest_multiplier(design, held):
    law, grid = design(held), Grid.of(held)
    into = transverse_dynamics(grid).into
    across, sizes = 1e-4 * np.random.default_rng(0).normal(size=(8, 3)), []
    for _ in range(STRIDES):
        sizes.append(np.linalg.norm(across))
        for j in range(0, len(grid.times), FINENESS):
            beside = across @ np.linalg.inv(into[j])[:, :3].T
            x = hybrid_states(grid.states[j] + np.vstack([np.zeros(4), beside]), SINGLE)
            advance(THESIS_PHYSICAL, x, law(x[:, :4]))
            later = into[(j + FINENESS) % len(into), :3]
            across = (x[1:, :4] - x[0, :4]) @ later.T
    measured = (sizes[-1] / sizes[1]) ** (1 / (STRIDES - 2))
    assert measured == pytest.approx(multipliers(law, held)[0], rel=0.1)
