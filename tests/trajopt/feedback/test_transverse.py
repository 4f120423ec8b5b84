from __future__ import annotations

import numpy as np
import pytest

from trajopt.feedback.orbit import FINENESS, Grid
from trajopt.feedback.transverse import transverse_dynamics


def clear_of_touchdowns(grid):
    """Which of the grid's times begin a period without a touchdown, nor one a node beside it."""
    node, touchdowns = grid.period / FINENESS, np.asarray(grid.solution.phase_times)
    after = (touchdowns - grid.times[:, None] + node) % grid.solution.duration
    return (after > grid.period + 2 * node).all(axis=1)


def test_a_wheel_that_is_ahead_on_the_gait_stays_as_much_ahead(held):
    grid = Grid.of(held)
    ahead = transverse_dynamics(grid).A[:, :, 3]
    clear = clear_of_touchdowns(grid)
    assert clear.mean() > 0.9
    assert ahead[clear] == pytest.approx(np.tile([0.0, 0.0, 0.0, 1.0], (clear.sum(), 1)), abs=0.02)
