"""The dynamics across an orbit, their LQR, and the multipliers of a law."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.linalg

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import advance, hybrid_states
from trajopt.feedback import transverse as module
from trajopt.feedback.laws import input_output, lqr
from trajopt.feedback.orbit import FINENESS, Grid
from trajopt.feedback.transverse import (
    Transverse,
    multipliers,
    riccati,
    transverse_dynamics,
    weights,
)

EFFORT, AHEAD = 0.2, 0.5

STRIDES = 4


@pytest.fixture(scope="module")
def grid(held):
    return Grid.of(held)


@pytest.fixture(scope="module")
def dynamics(grid):
    return transverse_dynamics(grid)


def clear_of_touchdowns(grid):
    """Which of the grid's times begin a period without a touchdown, nor one a node beside it."""
    node, touchdowns = grid.period / FINENESS, np.asarray(grid.solution.phase_times)
    after = (touchdowns - grid.times[:, None] + node) % grid.solution.duration
    return (after > grid.period + 2 * node).all(axis=1)


def test_a_wheel_that_is_ahead_on_the_gait_stays_as_much_ahead(grid, dynamics):
    ahead = dynamics.A[:, :, 3]
    clear = clear_of_touchdowns(grid)
    assert clear.mean() > 0.9
    assert ahead[clear] == pytest.approx(np.tile([0.0, 0.0, 0.0, 1.0], (clear.sum(), 1)), abs=0.02)


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


def test_the_surface_at_the_end_of_a_period_gives_the_gains_at_its_beginning(dynamics):
    found = riccati(dynamics, EFFORT, AHEAD)
    ends = np.roll(found.surface, -FINENESS, axis=0)
    assert np.allclose(found.gains, np.einsum("jc,jcd->jd", ends, dynamics.A))


def test_dynamics_that_no_voltage_holds_are_refused(unstable):
    _, B = unstable
    with pytest.raises(RuntimeError, match=r"still changes by .* no law holds this gait"):
        riccati(constant(2.0 * np.eye(4), B), EFFORT, AHEAD)


def test_a_recursion_that_runs_out_of_rounds_is_refused(unstable, monkeypatch):
    monkeypatch.setattr(module, "ROUNDS", 2)
    with pytest.raises(RuntimeError, match="after 2 strides"):
        riccati(constant(*unstable), EFFORT, AHEAD)


@pytest.mark.parametrize("design", [input_output.design, lqr.design], ids=["input_output", "lqr"])
def test_a_deviation_of_wheels_kept_in_step_decays_by_the_largest_multiplier(
    design, held, grid, dynamics
):
    law, into = design(held), dynamics.into
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
