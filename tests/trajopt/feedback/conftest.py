from __future__ import annotations

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.energy import ROW
from rimless_gym.kernel.stepping import MODE, STATE_SIZE, advance
from trajopt import Solution, periodic_gait
from trajopt.feedback.law import Law
from trajopt.feedback.laws import lqr

P = THESIS_PHYSICAL


@pytest.fixture(scope="session")
def held() -> Solution:
    return periodic_gait(P, 0.5, hold=0.01)


@pytest.fixture(scope="session")
def law(held: Solution) -> Law:
    """The LQR about the held gait."""
    return lqr.design(held)


@pytest.fixture
def walk():
    """Walks under a law: the totals of their second half, (N, len(ROW)), and the last states."""

    def walks(law, smooth, seconds, mode=0):
        states, ticks = np.zeros((len(smooth), STATE_SIZE)), round(100 * seconds)
        states[:, :4], states[:, MODE] = smooth, mode
        totals = np.zeros((len(states), len(ROW)))
        for tick in range(ticks):
            out = advance(P, states, law(states[:, :4], states[:, MODE].astype(int)))
            assert not out[:, ROW.failure].any(), f"fell after {0.01 * tick:.2f} s"
            totals += out if tick >= ticks // 2 else 0.0
        return totals, states

    return walks
