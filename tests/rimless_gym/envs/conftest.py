from __future__ import annotations

import gymnasium as gym
import pytest


@pytest.fixture
def env() -> gym.Env:
    return gym.make("RimlessWheel-v0")
