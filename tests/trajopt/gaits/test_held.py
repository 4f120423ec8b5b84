"""Gaits whose voltage is held: the environment repeats them, and nothing near costs less."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL, simulate
from rimless_gym.energy import ROW, Ledger
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from trajopt import NoGaitError, Solution, cot_front, periodic_gait
from trajopt.feedback import laws
from trajopt.gaits.held_gait import held_gait
from trajopt.gaits.held_stride import Pattern, held_speed, held_speeds, ticks_of_stride
from trajopt.gaits.library import index, repeated

P = THESIS_PHYSICAL
LOSSY = P.replace(
    gear_ratio=250,
    rotor_inertia=1e-7,
    hub_damping=0.005,
    idle_power=0.5,
    pendulum_length=0.26,
    pendulum_inertia=0.001,
)


@pytest.fixture(scope="module")
def continuous() -> Solution:
    return periodic_gait(P, P.step_length / 0.88, steps=1)


@pytest.fixture(scope="module")
def held(continuous: Solution) -> Solution:
    return periodic_gait(P, 0.5, steps=1, hold=0.01, guess=continuous)


def stepped(gait: Solution) -> tuple[np.ndarray, np.ndarray]:
    """The kernel's rows over a stride, and the state at its end."""
    states, rows = np.zeros((1, STATE_SIZE)), []
    states[0, :4] = gait.state(gait.first_tick)
    for volts in gait.held_voltages:
        rows.append(advance(gait.params, states, np.array([volts]), gait.hold)[0])
    return np.array(rows), states[0, :4]


def repeats(gait: Solution) -> bool:
    turned = np.array([0.0, 2 * np.pi * gait.theta_turns, 0.0, 0.0])
    return bool(np.abs(stepped(gait)[1] - gait.state(gait.first_tick) - turned).max() < 1e-9)


def test_the_kernel_repeats_it_and_closes_its_ledger(held):
    assert held.verification.passed, held.verification.failures
    assert repeats(held)
    ledger = Ledger.from_rows(stepped(held)[0].sum(axis=0), P)
    assert abs(ledger.residual) < 1e-9
    assert ledger.energy == held.verification.electrical_positive
    assert ledger.cost_of_transport(P) == pytest.approx(held.cot, rel=1e-10)


def test_the_environment_repeats_it_bit_for_bit_with_its_single_precision_actions(held):
    env = gymnasium.make("RimlessWheel-v0", params=P).unwrapped
    env.reset(options={"state": held.state(held.first_tick)})
    energy, steps = 0.0, 0.0
    for volts in held.held_voltages:
        action = np.array([volts / P.voltage_limit], dtype=np.float32)
        *_, info = env.step(action)
        energy += info["electrical_positive"]
        steps += env.measurements["steps"]
    rows, end = stepped(held)
    assert steps == 1
    assert energy == pytest.approx(rows[:, ROW.electrical_positive].sum(), rel=1e-14)
    np.testing.assert_array_equal(env.state[:4], end)


def test_its_voltage_is_constant_from_tick_to_tick_and_across_touchdowns(held):
    begins = held.first_tick + held.hold * np.arange(-1, 87)
    within = begins[:, None] + held.hold * np.array([1e-6, 0.3, 0.7, 1 - 1e-6])
    volts = held.control(within.ravel()).reshape(within.shape)
    assert np.ptp(volts, axis=1).max() == 0.0
    np.testing.assert_array_equal(volts[1:, 0], held.held_voltages[:-1])
    assert np.abs(np.diff(volts[:, 0])).max() > 0.1
    assert held.hold / 1e3 < held.first_tick < held.hold


def test_its_speed_is_the_nearest_possible_one_and_its_cost_a_little_above_the_optimum(
    held, continuous
):
    assert held.duration == pytest.approx(0.88, abs=1e-12)
    assert held.speed == pytest.approx(P.step_length / 0.88)
    assert continuous.cot < held.cot < 1.04 * continuous.cot


def test_the_reference_simulator_agrees_with_the_kernel(held):
    run = simulate(P, held.state(held.first_tick), held.held_voltages, held.duration)
    np.testing.assert_allclose(run.x[-1], stepped(held)[1], atol=1e-9)
    assert run.ledger.energy == pytest.approx(held.cost, rel=1e-5)


@pytest.mark.slow
def test_other_phases_of_the_clock_lead_to_no_better_optimum(held, continuous, monkeypatch):
    monkeypatch.setattr("trajopt.gaits.held_gait.SHARES", (0.6,))
    other, _ = held_gait(continuous, 0.01, 88, False, {})
    assert other is not None
    assert other.cot == pytest.approx(held.cot, rel=1e-3)


def test_it_is_saved_and_loaded_and_its_report_names_the_hold(held, tmp_path):
    held.save(tmp_path / "held.npz")
    again = Solution.load(tmp_path / "held.npz")
    assert again.hold == 0.01
    assert again.to_dict() == held.to_dict()
    assert repeats(again)
    assert "held for 10 ms (88 intervals)" in again.report()
    assert "repeats itself" in again.report()
    assert "held for 10 ms" in repr(again)


def test_shipped_gaits_have_no_clock():
    gait = index()[0].load()
    assert gait.hold is None
    with pytest.raises(ValueError, match=r"no clock.*hold=0\.01"):
        _ = gait.held_voltages


def test_with_regeneration_it_saves_what_the_battery_gives_back(held, continuous):
    recharged = periodic_gait(P, 0.5, 1, True, hold=0.01, guess=continuous)
    assert recharged.verification.passed
    assert recharged.cot_with_regeneration < held.cot_with_regeneration
    assert recharged.cot > held.cot


@pytest.mark.slow
def test_a_held_gait_is_continued_to_another_number_of_intervals(held):
    faster = periodic_gait(P, 0.506, 1, hold=0.01, guess=held)
    assert faster.verification.passed
    assert round(faster.duration / 0.01) == 87
    assert faster.cot < held.cot


@pytest.mark.slow
def test_a_machine_with_losses_has_a_gait_with_a_hold_of_20_ms():
    gait = periodic_gait("BUILDABLE", 0.56, hold=0.02)
    assert gait.verification.passed, gait.verification.failures


def test_where_there_is_no_gait_at_the_possible_speed_the_message_names_it():
    with pytest.raises(NoGaitError, match=r"2\.93893 m/s is the speed nearest to 2\.87 m/s"):
        periodic_gait(P, 2.87, 1, hold=0.01)


@pytest.mark.slow
def test_a_front_of_held_gaits_has_their_own_speeds_and_resumes(tmp_path, monkeypatch):
    front = cot_front(P, (0.5, 0.501, 0.506), steps=(1,), hold=0.01, folder=tmp_path)
    speeds = [P.step_length / 0.88, P.step_length / 0.87]
    assert [gait.speed for gait in front.solutions] == pytest.approx(speeds)
    assert all(gait.hold == 0.01 for gait in front.solutions)
    between = front(np.mean(speeds))
    assert between == pytest.approx(np.mean([gait.cot for gait in front.solutions]))
    monkeypatch.setattr("trajopt.gaits.fronts.periodic_gait", None)  # nothing is solved again
    again = cot_front(P, (0.5, 0.506), steps=(1,), hold=0.01, folder=tmp_path)
    assert [gait.cot for gait in again.solutions] == [gait.cot for gait in front.solutions]


@pytest.mark.slow
def test_a_stride_of_two_steps_walks_at_a_speed_between_and_moves_single_touchdowns(continuous):
    gait = periodic_gait(P, 0.5038, 2, hold=0.01, guess=repeated(continuous, 2))
    assert gait.verification.passed
    assert round(gait.duration / 0.01) == 175
    assert repeats(gait)
    assert gait.cot < 1.05 * continuous.cot


@pytest.mark.slow
def test_a_machine_with_losses_needs_its_idle_power_too():
    free = periodic_gait(LOSSY, LOSSY.step_length / 0.73, 1, starts=0)
    gait = periodic_gait(LOSSY, 0.6, 1, hold=0.01, guess=free)
    assert gait.verification.passed
    assert repeats(gait)
    assert free.cot < gait.cot < 1.03 * free.cot
    assert gait.cost > LOSSY.idle_power * gait.duration


@pytest.mark.slow
def test_feedback_about_it_holds_its_cost_at_a_hundred_hertz(held, continuous):
    costs = []
    for gait in (held, continuous):
        law, states = laws.holding("lqr", gait), np.zeros((8, STATE_SIZE))
        states[:, :4] = gait.state(np.linspace(0.05, 0.85, 8))
        rows = np.zeros((8, len(ROW)))
        for tick in range(3000):
            out = advance(P, states, law(states[:, :4], states[:, 4].astype(int)))
            rows += out if tick >= 1500 else 0.0
        energy, distance = rows[:, ROW.electrical_positive].sum(), rows[:, ROW.distance].sum()
        costs.append(energy / (P.weight * distance))
    assert costs[0] == pytest.approx(held.cot, rel=0.005)
    assert costs[1] > 1.03 * costs[0]


@pytest.mark.slow
def test_a_held_gait_leads_to_the_free_one_of_its_speed(held, continuous):
    free = periodic_gait(held.params, continuous.speed, 1, guess=held)
    assert free.hold is None
    assert free.verification.passed
    assert free.cot == pytest.approx(continuous.cot, rel=1e-3)


# -- clock and touchdowns --------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [0.2, 0.3, 0.5, 0.57, 0.6])
@pytest.mark.parametrize("steps", [1, 2, 3])
def test_no_other_whole_number_of_intervals_gives_a_speed_nearer_to_the_wanted_one(speed, steps):
    ticks = ticks_of_stride(P, speed, steps, 0.01)
    speeds = [steps * P.step_length / (n * 0.01) for n in (ticks - 1, ticks, ticks + 1)]
    off = [abs(each - speed) for each in speeds]
    assert off[1] == min(off)
    assert held_speed(P, speed, steps, 0.01) == pytest.approx(speeds[1], rel=1e-15)


def test_more_steps_in_a_stride_give_speeds_in_between():
    apart = [0.505 - held_speed(P, 0.505, steps, 0.01) for steps in (1, 2, 3)]
    assert abs(apart[1]) < abs(apart[0])
    assert abs(apart[2]) < abs(apart[0])


@pytest.mark.parametrize(
    ("speed", "steps", "hold", "named"),
    [
        (0.5, 1, 0.0005, "at least 0.001 s; leave it out"),
        (0.5, 1, 2.0, "at most 0.588 s at 0.5 m/s.*ask for at most 0.147 m/s"),
        (30.0, 1, 0.01, "two control intervals"),
        (0.05, 3, 0.001, "at most 3000 control intervals.*fewer steps or a higher speed"),
    ],
)
def test_clocks_that_are_too_fast_or_too_slow_are_refused(speed, steps, hold, named):
    with pytest.raises(ValueError, match=f"hold = {hold}: must be .*{named}"):
        ticks_of_stride(P, speed, steps, hold)


def test_held_speeds_are_all_that_a_clock_allows_between_two() -> None:
    speeds = held_speeds(P, 0.45, 0.55, 0.01)
    assert speeds[0] == held_speed(P, 0.45, 1, 0.01)
    assert speeds[-1] == held_speed(P, 0.55, 1, 0.01)
    ticks = [P.step_length / speed / 0.01 for speed in speeds]
    assert np.diff(ticks) == pytest.approx(-1.0)


def test_the_touchdowns_fall_into_the_intervals_around_them():
    pattern = Pattern.around(0.1, np.array([0.0, 0.53, 1.2]), first_tick=0.04)
    # Ticks at 0.04, 0.14, ..., 1.14: between 0 and 0.53 are five, then seven.
    assert pattern.whole == (4, 6)
    assert pattern.ticks == 12
    shares = np.array([0.9, 0.6])  # of the intervals from 0.44 and, before the start, from -0.06
    np.testing.assert_allclose(np.diff(pattern.edges_of(0, shares))[[0, 1, -1]], [0.04, 0.1, 0.09])
    assert pattern.edges_of(0, shares)[-1] == pytest.approx(0.53)
    assert pattern.edges_of(1, shares)[-1] == pytest.approx(0.67)


def test_an_interval_that_a_touchdown_splits_has_one_voltage_on_both_sides():
    pattern = Pattern(0.1, (4, 6))
    first, second = pattern.voltages_of(0), pattern.voltages_of(1)
    assert first[-1] == second[0]
    assert second[-1] == first[0]
    assert set(first) | set(second) == set(range(12))


def test_a_touchdown_can_be_moved_to_a_neighbouring_interval_if_there_is_one():
    assert Pattern(0.1, (4, 6)).moved(0, 1) == Pattern(0.1, (5, 5))
    assert Pattern(0.1, (0, 6)).moved(0, -1) is None
    assert Pattern(0.1, (4,)).moved(0, 1) == Pattern(0.1, (4,))
