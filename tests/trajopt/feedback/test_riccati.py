from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.linalg

from trajopt.feedback import riccati as module
from trajopt.feedback.orbit import FINENESS, Grid
from trajopt.feedback.riccati import riccati, weights
from trajopt.feedback.transverse import Transverse, transverse_dynamics

EFFORT, AHEAD = 0.2, 0.5


def constant(A, B):
    """Dynamics that are the same at every time of a stride of two periods."""
    m = 2 * FINENESS
    return Transverse(np.tile(A, (m, 1, 1)), np.tile(B, (m, 1, 1)), np.tile(np.eye(4), (m, 1, 1)))


@pytest.fixture
def unstable():
    rng = np.random.default_rng(0)
    return 0.6 * rng.normal(size=(4, 4)), rng.normal(size=(4, 1))


@pytest.mark.parametrize(("ahead", "n"), [(AHEAD, 4), (math.inf, 3)])
def test_it_is_the_textbooks_where_the_dynamics_are_constant(unstable, ahead, n):
    A, B = unstable
    found = riccati(constant(A, B), EFFORT, ahead)
    A, B, cost = A[:n, :n], B[:n], weights(ahead)[:n, :n]
    P = scipy.linalg.solve_discrete_are(A, B, cost, [[EFFORT]])
    surface = B.T @ P / (EFFORT + B.T @ P @ B)
    assert np.allclose(found.to_go[:, :n, :n], P, rtol=1e-6)
    assert np.allclose(found.surface[:, :n], surface, rtol=1e-6)
    assert np.allclose(found.gains[:, :n], surface @ A, rtol=1e-6, atol=1e-9)
    for values in (found.to_go[:, n:], found.surface[:, n:], found.gains[:, n:]):
        assert not values.any()


def test_the_surface_at_the_end_of_a_period_gives_the_gains_at_its_beginning(held):
    transverse = transverse_dynamics(Grid.of(held))
    found = riccati(transverse, EFFORT, AHEAD)
    ends = np.roll(found.surface, -FINENESS, axis=0)
    assert np.allclose(found.gains, np.einsum("jc,jcd->jd", ends, transverse.A))


def test_dynamics_that_no_voltage_holds_are_refused(unstable):
    _, B = unstable
    with pytest.raises(RuntimeError, match=r"still changes by .* no law holds this gait"):
        riccati(constant(2.0 * np.eye(4), B), EFFORT, AHEAD)


def test_a_recursion_that_runs_out_of_rounds_is_refused(unstable, monkeypatch):
    monkeypatch.setattr(module, "ROUNDS", 2)
    with pytest.raises(RuntimeError, match="after 2 strides"):
        riccati(constant(*unstable), EFFORT, AHEAD)
