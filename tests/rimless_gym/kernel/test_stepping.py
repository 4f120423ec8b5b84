"""The stepping kernel against the reference simulator, and its own conservation laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from rimless_gym import (
    BUILDABLE,
    PROTOTYPE,
    THESIS_NOMINAL,
    THESIS_PHYSICAL,
    WheelParams,
    hybrid,
    simulate,
)
from rimless_gym.energy import ROW, Ledger, Row, balance
from rimless_gym.equations import DOUBLE, MODE_NAMES, SINGLE
from rimless_gym.hybrid import CONTACT_LOST, CONTROL_PERIOD, OK, RATE_EXCEEDED
from rimless_gym.kernel.stepping import FOOT, MODE, STATE_SIZE, advance, machine_arrays

EVERYTHING = THESIS_PHYSICAL.replace(
    slope=0.1, rotor_inertia=1e-7, hub_damping=0.02, drag=0.3, idle_power=1.0, n_legs=7
)
MACHINES = {
    "THESIS_NOMINAL": THESIS_NOMINAL,
    "THESIS_PHYSICAL": THESIS_PHYSICAL,
    "PROTOTYPE": PROTOTYPE,
    "frame mount": THESIS_PHYSICAL.replace(motor_mount="frame"),
    "relabel law": THESIS_PHYSICAL.replace(impact_law="relabel"),
    "every loss, slope 0.1, 7 legs": EVERYTHING,
}


def random_states(params: WheelParams, rng: np.random.Generator, count: int) -> np.ndarray:
    p = params.constants
    states = np.zeros((count, STATE_SIZE))
    states[:, 0] = rng.uniform(p.a, p.b, count)
    states[:, 1] = rng.uniform(-math.pi, math.pi, count)
    states[:, 2] = rng.uniform(-3, 4, count)
    states[:, 3] = rng.uniform(-8, 8, count)
    return states


def walk(
    params: WheelParams, state: np.ndarray, voltages: np.ndarray, pull: float = math.inf
) -> Ledger:
    total = np.zeros(len(ROW))
    for voltage in voltages:
        total += advance(params, state[None], np.array([voltage]), pull=pull)[0]
    assert total[ROW.failure] == OK
    return Ledger.from_rows(total, params)


@pytest.mark.parametrize("name", MACHINES)
def test_kernel_and_reference_agree_on_states_events_and_energies(name: str) -> None:
    params, rng = MACHINES[name], np.random.default_rng(7)
    touchdowns = 0
    for smooth, start in enumerate(random_states(params, rng, 3)):
        volts = 6 * np.sin(np.arange(50) / 9) if smooth % 2 else rng.uniform(-15, 15, 50)
        reference = simulate(params, start[:4], volts, 0.5)
        state = start.copy()
        ledger = walk(params, state, volts)
        assert MODE_NAMES[int(state[MODE])] == reference.final_mode
        assert state[FOOT] == reference.foot[-1]
        assert np.abs(state[:4] - reference.x[-1]).max() < 1e-9
        ours, theirs = ledger.to_dict(), reference.ledger.to_dict()
        assert ours == pytest.approx(theirs, abs=1e-7)
        touchdowns += len(reference.touchdowns)
    assert touchdowns > 0


@pytest.mark.parametrize("name", MACHINES)
def test_from_random_states_the_ledger_balances_and_no_leg_sinks(name: str) -> None:
    params, rng = MACHINES[name], np.random.default_rng(1)
    states, p = random_states(params, rng, 300), params.constants
    for _ in range(20):
        volts = rng.uniform(-params.voltage_limit, params.voltage_limit, len(states))
        rows = advance(params, states, volts, pull=math.inf)
        for out in rows:
            ledger = Ledger.from_rows(out, params)
            in_play = max(abs(value) for value in ledger.to_dict().values())
            assert abs(ledger.residual) <= 1e-9 * max(in_play, 1.0)
            assert ledger.electrical_positive >= ledger.electrical - 1e-12
            assert params.impact_law != "plastic" or ledger.collision >= -1e-12
        states = states[rows[:, ROW.failure] == OK]
        assert np.all((states[:, 0] >= p.a - 1e-12) & (states[:, 0] <= p.b + 1e-12))


def test_many_intervals_balance_and_neither_chatter_nor_tunnel() -> None:
    rng, count, worst = np.random.default_rng(1), 0, 0.0
    while count < 200_000:
        base = list(MACHINES.values())[rng.integers(len(MACHINES))]
        params = base.replace(
            n_legs=int(rng.integers(3, 11)),
            slope=rng.uniform(-0.2, 0.2),
            hub_damping=rng.choice([0, 0.1]),
            drag=rng.choice([0, 0.5]),
            rotor_inertia=rng.choice([0, 1e-6]),
        )
        states, p = random_states(params, rng, 500), params.constants
        states[:, 2:4] = np.clip(rng.choice([0.1, 1, 5]) * states[:, 2:4], -40, 40)
        size, pull = rng.choice([0.2, 6, 20]), rng.choice([0, math.inf])
        for _ in range(40):
            out = advance(params, states, rng.uniform(-size, size, len(states)), pull=pull)
            count += len(out)
            terms = np.array(balance(Row(*out.T)._asdict()))
            in_play = np.maximum(1.0, np.abs(terms).max(axis=0))
            worst = max(worst, (np.abs(terms.sum(axis=0)) / in_play).max())
            assert np.all((states[:, 0] >= p.a - 1e-12) & (states[:, 0] <= p.b + 1e-12))
            assert set(out[:, ROW.failure]) <= {OK, CONTACT_LOST, RATE_EXCEEDED}
            states = states[out[:, ROW.failure] == OK]
            if len(states) == 0:
                break
    assert worst <= 1e-9


#: Machines, and states in which one long interval is hard: where dry friction stops psi' 40 ms
#: after its acceleration was still small, where windage damps a pendulum that swings back, and
#: where gravity swings a short pendulum 16 times in a second.
HARD_INTERVALS = {
    "friction": (
        WheelParams(
            wheel_mass=0.99,
            wheel_inertia=0.00015,
            leg_length=0.0574,
            n_legs=12,
            pendulum_mass=0.616,
            pendulum_inertia=0.346,
            pendulum_length=0.0167,
            motor_constant=0.000231,
            gear_ratio=3.89,
            armature_resistance=1.0,
            rotor_inertia=6.4e-9,
            hub_damping=0.00018,
            hub_friction=0.0236,
            gear_loss=0.323,
            friction_width=0.0105,
            drag=0.0038,
            gravity=8.29,
            voltage_limit=0.94,
        ),
        [1.5444, -0.7398, 0.6471, -0.8150, SINGLE, 0.0],
        -0.94,
        0.08,
    ),
    "windage": (
        WheelParams(
            wheel_mass=1.282,
            wheel_inertia=0.0246,
            leg_length=0.4475,
            n_legs=30,
            pendulum_mass=2.822,
            pendulum_inertia=0.002187,
            pendulum_length=0.2248,
            pendulum_reach=None,
            motor_constant=0.025636,
            gear_ratio=25.18,
            armature_resistance=1.8766,
            rotor_inertia=1.7e-6,
            hub_friction=0.0212,
            gear_loss=0.055,
            friction_width=0.1,
            pendulum_drag=0.1297,
            gravity=12.287,
            voltage_limit=9.82,
        ),
        [1.61516712, 0.19810381, -1.63327939, 0.32448165, SINGLE, 0.0],
        -8.838,
        0.03,
    ),
    "short pendulum": (
        WheelParams(
            wheel_mass=15.1,
            wheel_inertia=1.2e-5,
            leg_length=1.0,
            n_legs=5,
            pendulum_mass=95.2,
            pendulum_inertia=0.0002,
            pendulum_length=0.00113,
            motor_constant=0.0001,
            gear_ratio=3.29,
            armature_resistance=10.66,
            rotor_inertia=1.44e-7,
            hub_damping=2.7e-6,
            hub_friction=0.088,
            gear_loss=0.535,
            friction_width=1.0,
            drag=1.105,
            gravity=29.12,
            voltage_limit=1.0,
            impact_law="relabel",
        ),
        [0.9424778, 0.1488953, 0.0, 0.94798359, DOUBLE, 0.0],
        0.9,
        0.08,
    ),
}


@pytest.mark.parametrize("case", HARD_INTERVALS)
def test_one_long_interval_is_many_short_ones(case: str) -> None:
    params, start, voltage, duration = HARD_INTERVALS[case]
    ends = []
    for intervals in (1, 2, 8, 32):
        state = np.array([start])
        for _ in range(intervals):
            out = advance(params, state, np.array([voltage]), duration / intervals)[0]
            assert abs(Ledger.from_rows(out, params).residual) < 1e-9
        ends.append(state[0, :4])
    assert np.ptp(ends, axis=0).max() < 1e-8


def test_a_foot_that_lifts_off_slowly_comes_down_later_not_at_once() -> None:
    # Where a lift-off is located, rounding decides the sign of the leg's acceleration.
    params, n = BUILDABLE.replace(gear_loss=0.3), 20_000
    rng = np.random.default_rng(0)
    states = np.zeros((n, STATE_SIZE))
    states[:, 0], states[:, MODE] = params.constants.a, DOUBLE
    states[:, 1] = 0.9886 + rng.normal(size=n) * 10 ** rng.uniform(-6, -2, n)
    states[:, 3] = rng.normal(size=n) * 10 ** rng.uniform(-6, -2, n)
    volts = 12 * (-0.295 + rng.normal(size=n) * 10 ** rng.uniform(-6, -2, n))
    rows = advance(params, states, volts, 0.1)
    assert not rows[:, ROW.failure].any()
    assert rows[:, ROW.touchdowns].max() >= 2


def dropped(rate: float) -> np.ndarray:
    """A wheel that comes down on its leading foot at a small rate, with the pendulum hanging."""
    return np.array([THESIS_PHYSICAL.constants.b - 1e-3, 0.05, rate, 0.1, SINGLE, 0.0])


@pytest.mark.parametrize("rate", [0.05, 0.3, 1.0])
def test_the_zeno_sequence_ends_in_double_stance_with_the_same_energy_booked(rate: float) -> None:
    state = dropped(rate)
    reference = simulate(THESIS_PHYSICAL, state[:4], np.zeros(100), 1.0)
    ledger = walk(THESIS_PHYSICAL, state, np.zeros(100))
    assert reference.final_mode == "double_stance"
    assert state[MODE] == DOUBLE
    assert len(reference.touchdowns) > 3
    assert ledger.collision == pytest.approx(reference.ledger.collision, abs=1e-10)
    assert np.abs(state[:4] - reference.x[-1]).max() < 1e-9


LIGHT = THESIS_PHYSICAL.replace(
    leg_length=0.07, n_legs=4, pendulum_mass=0.3, wheel_inertia=0.001, impact_law="relabel"
)


@pytest.mark.parametrize("rate", [2e-3, 5e-3])
@pytest.mark.parametrize("slope", [0.0, 0.05])
def test_a_wheel_with_lossless_touchdowns_rocks_until_it_rests(rate, slope) -> None:
    params = LIGHT.replace(slope=slope)
    state = np.array([params.constants.a, slope + 0.01, rate, 0.05, SINGLE, 0])
    reference = simulate(params, state[:4], np.zeros(20), 0.2, pull=0.0)
    ledger = walk(params, state, np.zeros(20), pull=0.0)
    assert reference.failure is None
    assert MODE_NAMES[int(state[MODE])] == reference.final_mode == "double_stance"
    assert np.abs(state[:4] - reference.x[-1]).max() < 1e-9
    ours, theirs = ledger.to_dict(), reference.ledger.to_dict()
    assert ours == pytest.approx(theirs, rel=1e-4, abs=1e-9)
    assert abs(ledger.residual) < 1e-12
    assert abs(reference.ledger.residual) < 1e-12


@pytest.mark.parametrize("excess", [1e-3, 1e-7, -1e-7])
def test_grazing_touchdowns_are_hit_or_missed_as_in_the_reference(excess: float) -> None:
    params, p = THESIS_PHYSICAL, THESIS_PHYSICAL.constants
    pushing = np.full(30, -12.0)  # turns the wheel back on its way forward

    def top(rate: float) -> float:
        """The leg's largest angle: where its rate changes sign, if it does."""
        free = params.replace(n_legs=3)  # no touchdown until far beyond b of five legs
        motion = simulate(free, [1.9, -1.0, rate, 0.0], pushing, 0.3)
        times = np.linspace(0.0, motion.t[-1], 301)
        k = min(max(int(np.argmax(motion.state(times)[:, 0])), 1), 299)
        around = times[[k - 1, k + 1]]
        if np.prod(motion.state(around)[:, 2]) < 0:
            turn = brentq(lambda t: motion.state(t)[2], *around, xtol=1e-15)
            return float(motion.state(turn)[0])
        return float(motion.state(times[k])[0])

    rate = brentq(lambda rate: top(rate) - p.b - excess, 0.5, 3.0, xtol=1e-13)
    state = np.array([1.9, -1.0, rate, 0.0, SINGLE, 0.0])
    reference = simulate(params, state[:4], pushing, 0.3)
    touchdowns = 0.0
    for voltage in pushing:
        out = advance(params, state[None], np.array([voltage]), pull=math.inf)[0]
        touchdowns += out[ROW.touchdowns]
    assert touchdowns == len(reference.touchdowns)
    assert np.abs(state[:4] - reference.x[-1]).max() < 1e-7


def test_loss_of_contact_is_located_where_the_normal_force_vanishes() -> None:
    params, rng = THESIS_PHYSICAL, np.random.default_rng(4)
    states = random_states(params, rng, 400)
    states[:, 3] *= 2
    located = 0
    for _ in range(30):
        rows = advance(params, states, np.zeros(len(states)))
        lost = (rows[:, ROW.failure] == CONTACT_LOST) & (rows[:, ROW.elapsed] > 0)
        lost &= rows[:, ROW.touchdowns] == 0  # an impact makes the force jump
        assert np.abs(rows[lost, ROW.force_y]).max(initial=0) < 1e-6
        located += np.count_nonzero(lost)
        states = states[rows[:, ROW.failure] == OK]
    assert located > 20


def test_a_motion_ends_with_the_step_that_exceeds_the_fastest_rate() -> None:
    strong = THESIS_PHYSICAL.replace(pendulum_length=0.0, pendulum_inertia=0.3)
    states = random_states(strong, np.random.default_rng(5), 2000)
    states[:, 3] = 59.0
    rows = advance(strong, states, np.linspace(100, 400, 2000), pull=math.inf)
    fast = np.abs(states[:, 2:4]).max(axis=1) > hybrid.MAX_RATE
    assert 100 < np.count_nonzero(fast) < 1900
    assert np.array_equal(rows[:, ROW.failure] == RATE_EXCEEDED, fast)
    assert np.all(rows[:, ROW.elapsed] > 0)


def test_a_wheel_resting_on_two_feet_lifts_off_when_a_foot_would_be_pulled() -> None:
    params, p = THESIS_PHYSICAL, THESIS_PHYSICAL.constants
    state = np.array([[p.a, 0.0, 0.0, 0.0, DOUBLE, 0.0]])
    for _ in range(100):
        before = state[0].copy()
        advance(params, state, np.array([-20.0]))
        if state[0, MODE] == SINGLE:
            break
    assert state[0, MODE] == SINGLE
    assert hybrid.both_feet_press(before[1], before[3], -20.0, p)
    reference = simulate(params, [p.a, 0, 0, 0], np.full(100, -20.0), 1.0, mode="double_stance")
    assert reference.events[0].kind == "lift_off"
    leading, trailing = hybrid.lift_off_guards(*reference.events[0].before[[1, 3]], -20.0, p)
    assert min(abs(leading), abs(trailing)) < 1e-8


@pytest.mark.parametrize("name", ["THESIS_PHYSICAL", "PROTOTYPE"])
def test_no_brief_touchdown_within_a_step_is_missed(name: str) -> None:
    params, rng, count = MACHINES[name], np.random.default_rng(12), 10_000
    p = params.constants
    whole = random_states(params, rng, count)
    whole[:, 0] = rng.choice([p.a, p.b], count)
    whole[:, 0] += np.sign(math.pi / 2 - whole[:, 0]) * rng.uniform(0, 3e-3, count)
    whole[:, 2] = rng.normal(0, 0.1, count)
    whole[:, 3] = rng.uniform(-15, 15, count)
    parts, volts = whole.copy(), rng.uniform(-20, 20, count)
    rows = advance(params, whole, volts, pull=math.inf)
    touchdowns = sum(
        advance(params, parts, volts, 0.01 / 8, math.inf)[:, ROW.touchdowns] for _ in range(8)
    )
    assert touchdowns.sum() > 300
    assert np.array_equal(rows[:, ROW.touchdowns], touchdowns)
    assert np.array_equal(whole[:, [MODE, FOOT]], parts[:, [MODE, FOOT]])


def test_air_drag_that_would_need_too_many_steps_is_refused() -> None:
    params = THESIS_PHYSICAL.replace(drag=1e20, pendulum_inertia=1e20)
    with pytest.raises(ValueError, match=r"drag = 1e\+20 and pendulum_drag = 0 damp"):
        machine_arrays([params])
    machine_arrays([THESIS_PHYSICAL.replace(drag=100.0)])


def test_work_is_split_where_the_current_changes_sign_twice_in_one_interval() -> None:
    start, volts = (1.67365781, -0.12882735, 0.10302742, 11.61752467), np.array([5.6262938])
    rows = advance(BUILDABLE, np.array([[*start, 0.0, 0.0]]), volts, pull=math.inf)[0]
    ledger = Ledger.from_rows(rows, BUILDABLE)
    known = simulate(BUILDABLE, start, volts, CONTROL_PERIOD).ledger
    assert known.electrical_positive > max(known.electrical, 0.0) + 1e-5
    assert ledger.electrical_positive == pytest.approx(known.electrical_positive, abs=1e-8)
    assert ledger.shaft == pytest.approx(known.shaft, abs=1e-8)
