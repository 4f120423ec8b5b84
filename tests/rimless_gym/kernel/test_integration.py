"""The order of the integration step and of the interpolation between its ends."""

from __future__ import annotations

import itertools
import math

import numpy as np

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.jit import cached
from rimless_gym.kernel import tile as slot
from rimless_gym.kernel.accounting import open_interval
from rimless_gym.kernel.attempt import attempt_step
from rimless_gym.kernel.integration import quintic, smooth_states, upward_root, value
from rimless_gym.kernel.stepping import scratch, share_machine
from rimless_gym.kernel.tile import TILE_SIZE
from rimless_gym.trigonometry import MAX_TURN


@cached()
def opened(work, constants, poles, duration):
    share_machine(work, constants, poles)
    open_interval(work[:TILE_SIZE], duration, 0.0)


@cached()
def attempted(tile, duration):
    return attempt_step(tile, 1, duration, 0.0)


START, VOLTS = (1.3, 0.8, 2.0, -4.0), 7.0


def stepped(duration: float, steps: int) -> np.ndarray:
    *_, end = smooth_states(THESIS_PHYSICAL, START, VOLTS, duration, steps)
    return np.array(end)


def test_halving_the_step_divides_the_error_by_two_to_the_eighth() -> None:
    exact = stepped(0.4, 128)
    errors = [np.abs(stepped(0.4, n) - exact).max() for n in (6, 12, 24)]
    orders = [math.log2(coarse / fine) for coarse, fine in itertools.pairwise(errors)]
    assert min(orders) > 7.8
    assert errors[-1] < 1e-10


def test_the_interpolating_quintic_is_exact_for_quintics_and_of_sixth_order() -> None:
    polynomial = np.polynomial.Polynomial([0.3, -1.0, 0.5, 2.0, -0.7, 0.1])
    rate, acceleration = polynomial.deriv(), polynomial.deriv(2)
    h = 0.8
    c = quintic(*(f(t) for t in (0.0, h) for f in (polynomial, rate, acceleration)), h)
    s = np.linspace(0, 1, 11)
    assert np.abs(value(c, s) - polynomial(h * s)).max() < 1e-14

    def error(h: float) -> float:
        c = quintic(0.0, 1.0, 0.0, math.sin(h), math.cos(h), -math.sin(h), h)
        return float(np.abs(value(c, s) - np.sin(h * s)).max())

    assert math.log2(error(0.4) / error(0.2)) > 5.8


def test_a_root_at_the_start_is_skipped_if_the_polynomial_falls_there() -> None:
    assert upward_root((0.0, 1.0, 0.0, 0.0, 0.0, 0.0), 1.0) == 0.0
    assert upward_root((0.0, -0.5, 1.0, 0.0, 0.0, 0.0), 1.0) == 0.5
    assert abs(upward_root((0.0, 0.0, -0.25, 1.0, 0.0, 0.0), 1.0) - 0.25) < 1e-15
    assert abs(upward_root((-0.125, 0.0, 0.0, 1.0, 0.0, 0.0), 1.0) - 0.5) < 1e-15


def test_an_attempt_in_which_an_angle_turns_too_far_is_halved() -> None:
    work, p = scratch(), THESIS_PHYSICAL
    tile = work[: slot.TILE_SIZE]
    lane = tile.reshape(-1, slot.LANES)[:, 0]
    state, attempt, left = (q // slot.LANES for q in (slot.STATE, slot.ATTEMPT, slot.LEFT))
    lane[state : state + 4] = start = (1.5, 0.0, 0.3, 8.0)
    opened(work, p.constants_array[:, None].copy(), np.array([p.motor_pole]), 0.1)
    lane[attempt] = 0.1  # far longer than a planned step
    tried = []
    while lane[left] == 0.1:
        tried.append(lane[attempt])
        assert np.array_equal(lane[state : state + 4], start)
        assert attempted(tile, 0.1) == 1
    assert tried == [0.1, 0.05, 0.025]
    assert lane[left] == 0.1 - 0.025
    assert 0.5 * MAX_TURN < lane[state + 1] < MAX_TURN
