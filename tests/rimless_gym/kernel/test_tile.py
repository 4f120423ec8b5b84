"""Tiles: no wheel affects its neighbours; the order of the integration step."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from rimless_gym import PROTOTYPE, THESIS_PHYSICAL, WheelParams
from rimless_gym.energy import ROW
from rimless_gym.equations import DOUBLE
from rimless_gym.hybrid import CONTACT_LOST, OK, TOO_MANY_EVENTS
from rimless_gym.kernel import integration
from rimless_gym.kernel import tile as slot
from rimless_gym.kernel.accounting import measure, open_interval
from rimless_gym.kernel.attempt import check_attempt, plan
from rimless_gym.kernel.integration import rk8, smooth_states
from rimless_gym.kernel.stepping import (
    MODE,
    STATE_SIZE,
    advance,
    advance_batch,
    machine_arrays,
    scratch,
    share_machine,
)
from rimless_gym.kernel.tile import LANES, TILE_SIZE
from rimless_gym.trigonometry import MAX_TURN

MACHINES = (
    THESIS_PHYSICAL,
    PROTOTYPE,
    THESIS_PHYSICAL.replace(n_legs=8, slope=0.05, drag=0.2, hub_damping=0.05),
)


def restless_states(count: int, seed: int) -> np.ndarray:
    """States in columns, from wheels at rest to ones that touch down, lose contact or race."""
    rng = np.random.default_rng(seed)
    states = np.zeros((STATE_SIZE, count))
    p = THESIS_PHYSICAL.constants
    states[0] = rng.choice([p.a + 1e-9, p.b - 1e-3, 0.5 * math.pi], count)
    states[1] = rng.uniform(-math.pi, math.pi, count)
    states[2], states[3] = rng.uniform(-4, 4, count), rng.uniform(-25, 25, count)
    rest = rng.random(count) < 0.2
    states[0, rest], states[2, rest], states[3, rest], states[MODE, rest] = p.a, 0, 0.1, DOUBLE
    return states


def run(
    machines: list[WheelParams], states: np.ndarray, volts: np.ndarray, intervals: int = 8
) -> tuple[np.ndarray, np.ndarray]:
    """States after some intervals, and the totals of the last one."""
    states, out, work = states.copy(), np.empty((len(ROW), states.shape[1])), scratch()
    arrays = machine_arrays(machines)
    for k in range(intervals):
        u = np.ascontiguousarray(volts[k])
        advance_batch(*arrays, states, u, 0, states.shape[1], 0.01, 0.0, out, work)
    return states, out


@pytest.mark.parametrize("machine", MACHINES)
def test_a_wheel_moves_the_same_to_the_last_bit_whatever_moves_beside_it(machine):
    states = restless_states(101, seed=1)
    volts = np.random.default_rng(2).uniform(-20, 20, (8, 101))
    together, rows = run([machine], states, volts)
    assert {OK, CONTACT_LOST} <= set(rows[ROW.failure])
    order = np.random.default_rng(3).permutation(101)
    shuffled, shuffled_rows = run([machine], states[:, order].copy(), volts[:, order])
    assert np.array_equal(together[:, order], shuffled)
    assert np.array_equal(rows[:, order], shuffled_rows)
    for i in range(101):
        alone, alone_rows = run([machine], states[:, i : i + 1].copy(), volts[:, i : i + 1])
        assert np.array_equal(together[:, i : i + 1], alone)
        assert np.array_equal(rows[:, i : i + 1], alone_rows)


def test_different_machines_in_a_tile_move_as_each_does_among_equal_ones():
    which = np.arange(90) % len(MACHINES)
    states = restless_states(90, seed=4)
    volts = np.random.default_rng(5).uniform(-20, 20, (8, 90))
    mixed, rows = run([MACHINES[k] for k in which], states, volts)
    for k, machine in enumerate(MACHINES):
        here = which == k
        alone, alone_rows = run([machine], states[:, here].copy(), volts[:, here])
        assert np.array_equal(mixed[:, here], alone)
        assert np.array_equal(rows[:, here], alone_rows)


def test_advancing_some_columns_gives_the_same_and_leaves_the_others_alone():
    states = restless_states(60, seed=6)
    volts = np.random.default_rng(7).uniform(-20, 20, (1, 60))
    whole, rows = run([THESIS_PHYSICAL], states, volts, intervals=1)
    part, out, work = states.copy(), np.full((len(ROW), 60), 7.0), scratch()
    advance_batch(
        *machine_arrays([THESIS_PHYSICAL]), part, volts[0].copy(), 13, 42, 0.01, 0.0, out, work
    )
    assert np.array_equal(part[:, 13:42], whole[:, 13:42])
    assert np.array_equal(out[:, 13:42], rows[:, 13:42])
    assert np.array_equal(part[:, :13], states[:, :13])
    assert np.all(out[:, 42:] == 7.0)


def test_no_machine_of_an_earlier_call_is_left_in_the_work_space():
    states = restless_states(3, seed=8)
    volts = np.zeros(3)
    fresh, used = scratch(), scratch()
    out = np.empty((len(ROW), 3))
    for machines in ([PROTOTYPE], list(MACHINES)):
        advance_batch(*machine_arrays(machines), states.copy(), volts, 0, 3, 0.01, 0.0, out, used)
    results = []
    for work in (fresh, used):
        x = states.copy()
        advance_batch(*machine_arrays([THESIS_PHYSICAL]), x, volts, 0, 3, 0.01, 0.0, out, work)
        results.append(x)
    assert np.array_equal(*results)


def test_the_time_of_the_last_touchdown_is_reported():
    p = THESIS_PHYSICAL.constants
    start = np.array([[p.b - 0.004, 0.0, 1.0, 0.0, 0, 0]])
    whole = start.copy()
    rows = advance(THESIS_PHYSICAL, whole, np.zeros(1))[0]
    assert rows[ROW.touchdowns] == 1
    before = start.copy()
    shorter = advance(THESIS_PHYSICAL, before, np.zeros(1), rows[ROW.touchdown_time] * (1 - 1e-9))
    assert shorter[0, ROW.touchdowns] == 0
    assert before[0, 0] == pytest.approx(p.b, abs=1e-8)
    upright = np.array([[1.5, 0.0, 0.0, 0.0, 0, 0]])
    assert advance(THESIS_PHYSICAL, upright, np.zeros(1))[0, ROW.touchdown_time] == -1


def test_a_wheel_that_rolls_over_hundreds_of_legs_in_an_interval_is_an_error():
    rim = THESIS_PHYSICAL.replace(n_legs=10**6, motor_constant=0.0)
    state = np.array([[rim.constants.a, 0.0, 2.0, 0.0, 0, 0]])
    rows = advance(rim, state, np.zeros(1), pull=math.inf)[0]
    assert rows[ROW.failure] == TOO_MANY_EVENTS
    assert rows[ROW.touchdowns] == 201
    assert 0 < rows[ROW.elapsed] < 0.01


START, VOLTS = (1.3, 0.8, 2.0, -4.0), 7.0


def stepped(duration: float, steps: int) -> np.ndarray:
    *_, end = smooth_states(THESIS_PHYSICAL, START, VOLTS, duration, steps)
    return np.array(end)


def test_halving_the_step_divides_the_error_by_two_to_the_eighth(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As plain Python, because compiling it takes longer; the empty lanes divide by zero."""
    monkeypatch.setattr(integration, "_smooth_step", integration._smooth_step.py_func)
    with np.errstate(all="ignore"):
        exact = stepped(0.4, 64)
        errors = [np.abs(stepped(0.4, n) - exact).max() for n in (6, 12, 24)]
    orders = [math.log2(coarse / fine) for coarse, fine in itertools.pairwise(errors)]
    assert min(orders) > 7.8
    assert errors[-1] < 1e-10


def test_an_attempt_in_which_an_angle_turns_too_far_is_halved() -> None:
    """These functions are compiled where they are used; here they run as plain Python."""
    work, p = scratch(), THESIS_PHYSICAL
    tile, lanes = work[:TILE_SIZE], work[:TILE_SIZE].reshape(-1, LANES)
    lanes[slot.STATE // LANES :][:4] = np.array([1.5, 0.0, 0.3, 8.0])[:, None]
    share_machine(work, p.constants_array[:, None].copy(), np.array([p.motor_pole]))
    open_interval(tile, 0.1, 0.0)
    for length, kept in ((0.1, False), (0.05, False), (0.025, True)):
        lanes[slot.ATTEMPT // LANES] = length  # the first two are longer than a planned step
        plan(tile)
        rk8(tile)
        _, _, flagged = measure(tile, 0.0)
        if flagged:
            assert check_attempt(tile, 0, 0.0) is kept
        assert kept or lanes[slot.ATTEMPT // LANES, 0] == length / 2
    assert 0.5 * MAX_TURN < lanes[slot.NEXT // LANES + 1, 0] < MAX_TURN
