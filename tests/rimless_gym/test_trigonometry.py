"""The vectorised sine and cosine against those of the mathematical library."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import mpmath
import numpy as np
import pytest
from numba import njit

from rimless_gym.trigonometry import MAX_TURN, cos, cos_turned, sin, sin_turned


def compiled_for(target: str, features: str) -> list[str]:
    """Errors of sine and cosine up to 1e5 rad, measured in another process."""
    code = (
        "import numpy as np; from tests.rimless_gym.test_trigonometry import both\n"
        "x = np.random.default_rng(3).uniform(-1e5, 1e5, 20_000); s, c = both(x)\n"
        "print(np.abs(s - np.sin(x)).max() < 2.5e-16, np.abs(c - np.cos(x)).max() < 2.5e-16)"
    )
    environment = {"NUMBA_CPU_NAME": target, "NUMBA_CPU_FEATURES": features}
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
        env=os.environ | environment,
    )
    return done.stdout.split()


@njit
def both(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    s, c = np.empty_like(x), np.empty_like(x)
    for i in range(len(x)):
        s[i], c[i] = sin(x[i]), cos(x[i])
    return s, c


@pytest.mark.parametrize("size", [1e-3, 1.0, 10.0, 1e3, 1e5])
def test_sine_and_cosine_are_accurate_to_the_last_bit_of_one(size):
    x = np.random.default_rng(0).uniform(-size, size, 50_000)
    s, c = both(x)
    assert np.abs(s - np.sin(x)).max() < 2.5e-16
    assert np.abs(c - np.cos(x)).max() < 2.5e-16


def test_they_are_as_accurate_without_fused_multiply_add() -> None:
    assert compiled_for("x86-64", "") == ["True", "True"]


def test_sine_is_odd_and_cosine_even_and_both_exact_at_zero():
    x = np.random.default_rng(1).uniform(-50, 50, 10_000)
    (s, c), (mirrored, same) = both(x), both(-x)
    assert np.array_equal(mirrored, -s)
    assert np.array_equal(same, c)
    assert both(np.zeros(1)) == (0.0, 1.0)


def test_quadrants_are_distinguished_at_their_borders():
    x = np.arange(-40, 41) * (np.pi / 4) + np.array([[-1e-9], [0.0], [1e-9]])
    s, c = both(x.ravel())
    assert np.abs(s - np.sin(x.ravel())).max() < 2.5e-16
    assert np.abs(c - np.cos(x.ravel())).max() < 2.5e-16


def test_angles_a_small_turn_away_from_known_ones_are_as_accurate():
    rng = np.random.default_rng(2)
    start, turn = rng.uniform(-50, 50, 4_000), rng.uniform(-MAX_TURN, MAX_TURN, 4_000)
    turn[:2] = -MAX_TURN, MAX_TURN
    known = np.sin(start), np.cos(start)
    angles = list(zip(*known, turn, strict=True))
    for ours, theirs in ((sin_turned, mpmath.sin), (cos_turned, mpmath.cos)):
        with mpmath.workprec(120):
            exact = [float(theirs(mpmath.mpf(x) + d)) for x, d in zip(start, turn, strict=True)]
        assert np.abs(np.subtract([ours(angle) for angle in angles], exact)).max() < 3.5e-16
    still = 0.6, 0.8, 0.0
    assert (sin_turned(still), cos_turned(still)) == still[:2]
