from __future__ import annotations

import pytest

from rimless_gym import THESIS_PHYSICAL
from trajopt import Solution, periodic_gait


@pytest.fixture(scope="session")
def gait() -> Solution:
    return periodic_gait(THESIS_PHYSICAL, speed=0.5, steps=2)


@pytest.fixture(scope="session")
def one_step() -> Solution:
    return periodic_gait(THESIS_PHYSICAL, speed=0.5, steps=1)
