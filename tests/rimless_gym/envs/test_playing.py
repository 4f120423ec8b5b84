"""Driving the wheel by hand with `gymnasium.utils.play`."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.play import play

from rimless_gym.rendering.canvas import pygame


@pytest.fixture(autouse=True)
def _no_screen(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    yield
    pygame.display.quit()


def test_the_arrow_keys_set_the_voltage_and_no_key_means_zero() -> None:
    pressed = [
        (pygame.KEYDOWN, pygame.K_RIGHT, 1.0),
        (pygame.KEYDOWN, pygame.K_DOWN, 0.5),
        (pygame.KEYUP, pygame.K_DOWN, 1.0),
        (pygame.KEYUP, pygame.K_RIGHT, 0.0),
        (pygame.KEYDOWN, pygame.K_LEFT, -1.0),
        (pygame.KEYDOWN, pygame.K_DOWN, -0.5),
    ]
    given = []

    def press(before: Any, after: Any, action: Any, *rest: Any) -> None:
        given.append(float(np.ravel(action)[0]))  # 0 where no key is pressed
        if len(given) <= len(pressed):
            kind, key, _ = pressed[len(given) - 1]
            pygame.event.post(pygame.event.Event(kind, key=key))
        else:
            pygame.event.post(pygame.event.Event(pygame.QUIT))

    play(gym.make("RimlessWheel-v0", render_mode="rgb_array"), seed=0, fps=1000, callback=press)
    assert given == [0.0, *(volts for *_, volts in pressed)]
