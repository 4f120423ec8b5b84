"""The laws that are designed in an instant: each holds its gait, and does what its page states."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.energy import ROW
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from trajopt.feedback import laws
from trajopt.feedback.constraint import constraint_of, output, phase_of
from trajopt.feedback.laws import input_output, lqr, pid, sliding_mode
from trajopt.feedback.orbit import mean_voltage, squared_distances
from trajopt.feedback.transverse import multipliers

P = THESIS_PHYSICAL


def path(law, x, seconds):
    """The states (ticks, N, 4), the voltages (ticks, N) and the steps (N,) of walks."""
    states = np.zeros((len(x), STATE_SIZE))
    states[:, :4] = x
    visited, voltages, steps = [], [], np.zeros(len(x))
    for _ in range(round(seconds / 0.01)):
        visited.append(states[:, :4].copy())
        voltages.append(law(visited[-1]))
        out = advance(P, states, voltages[-1])
        assert not out[:, ROW.failure].any()
        steps += out[:, ROW.steps]
    return np.array(visited), np.array(voltages), steps


def changed(law, **numbers):
    """The law with other numbers."""
    return dataclasses.replace(law, data=law.data._replace(**numbers))


def distances(law, states):
    return np.sqrt(squared_distances(np.ascontiguousarray(states), law.data.orbit))


# -- every law ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.slow] * (n in laws.SLOW)) for n in laws.names()],
)
def test_every_law_in_the_folder_keeps_stepping_from_its_gait(name, held, walk):
    totals, _ = walk(laws.holding(name, held), held.state(np.linspace(0.05, 0.85, 4)), 8.0)
    assert totals[:, ROW.steps].min() >= 4


@pytest.fixture(
    scope="module",
    params=[pid, input_output, sliding_mode],
    ids=lambda law: law.__name__.split(".")[-1],
)
def each(request, one_step):
    return request.param.design(one_step)


def test_a_law_holds_its_gait(each, one_step):
    x = one_step.state(np.linspace(0.1, 0.75, 3))
    visited, _, steps = path(each, x, 8.0)
    assert np.all(abs(steps - 8.0 / one_step.duration) < 1.5)
    assert distances(each, visited[400:].reshape(-1, 4)).max() < 0.1


def test_on_the_gait_a_law_plays_the_gaits_own_voltage(each, one_step):
    t = np.linspace(0.03, one_step.duration - 0.03, 201)
    wanted = mean_voltage(one_step, t, 0.01)
    assert np.abs(each(one_step.state(t)) - wanted).max() < 0.05


def test_a_deviation_decays_whether_small_or_not(each, one_step):
    assert multipliers(each, one_step)[0] < 0.9
    x = one_step.state(0.4) + [[0.0, 0.0, 0.1, 0.0], [0.0, 0.0, 0.0, -0.2]]
    visited, _, _ = path(each, x, 5 * one_step.duration)
    assert np.all(distances(each, visited[-1]) < 0.8 * distances(each, visited[0]))


def test_a_law_does_not_see_whole_turns_of_the_pendulum(each, one_step):
    x = one_step.state(np.linspace(0.02, 0.8, 20)) + 0.01
    assert np.allclose(each(x), each(x + [0, 2 * np.pi, 0, 0]))


# -- LQR ------------------------------------------------------------------------------------------


def test_the_lqr_holds_a_gait_for_its_cost_and_in_step_with_its_clock(law, held, walk):
    totals, states = walk(law, held.state(np.linspace(0.05, 0.85, 8)), 20.0)
    distance, energy = totals[:, ROW.distance].sum(), totals[:, ROW.electrical_positive].sum()
    assert distance / (8 * 10.0) == pytest.approx(held.speed, rel=1e-3)
    assert energy / (P.weight * distance) == pytest.approx(held.cot, rel=5e-3)
    ticks = held.state(held.first_tick + 0.01 * np.arange(round(held.duration / 0.01) - 1))
    off = states[:, None, :4] - ticks
    off[:, :, 1] -= 2 * np.pi * np.round(off[:, :, 1] / (2 * np.pi))
    assert np.linalg.norm(off / np.std(ticks, axis=0), axis=2).min(axis=1).max() < 5e-3

    without_clock, _ = walk(lqr.design(held, ahead=None), states[:, :4], 20.0)
    energy_per_metre = without_clock[:, ROW.electrical_positive].sum()
    energy_per_metre /= without_clock[:, ROW.distance].sum()
    assert energy_per_metre > 1.001 * energy / distance


def test_under_the_lqr_deviations_die_out(law, held, walk):
    starts = held.state(np.linspace(0.3, 0.6, 6)) + [0.0, 0.0, 0.05, -0.05]
    _, states = walk(law, starts, 6.0)
    before = squared_distances(starts, law.data.orbit)
    after = squared_distances(np.ascontiguousarray(states[:, :4]), law.data.orbit)
    assert (after < 0.01 * before).all()


@pytest.mark.parametrize("begin", [0.1, 0.4, 0.6, 0.8])
def test_the_voltage_of_the_lqr_has_no_jumps_beside_the_gait(law, held, begin):
    t = begin + np.linspace(0.0, 0.004, 1000)  # half a dozen of the table's nodes
    changes = np.abs(np.diff(law(held.state(t) + [0.002, 0.01, 0.01, 0.02])))
    assert changes.max() < 20 * changes.mean()


def test_the_lqr_holds_a_gait_of_two_steps_with_a_continuous_voltage(gait, walk):
    totals, _ = walk(lqr.design(gait), gait.state(np.linspace(0.05, 1.7, 8)), 10.0)
    assert totals[:, ROW.steps].min() >= 4


# -- virtual constraints --------------------------------------------------------------------------


def test_no_gain_of_the_input_output_law_changes_the_motion_along_the_constraint(one_step):
    first, second = (
        multipliers(changed(input_output.design(one_step), kp=rate**2, kd=2 * rate), one_step)[0]
        for rate in (20.0, 40.0)
    )
    assert first == pytest.approx(second, rel=0.05)


def test_the_output_decays_as_its_equation_says(one_step):
    linearising = changed(input_output.design(one_step), kp=100.0, kd=20.0)
    x = one_step.state(0.2) + [0.001, 0.0, 0.0, 0.0]
    visited, _, _ = path(linearising, x[None], 0.31)
    outputs = [output(x, linearising.data.constraint, P.constants) for x in visited[:, 0]]
    t = 0.01 * np.arange(len(outputs))
    y, dy = outputs[0].y, outputs[0].dy
    wanted = (y + (dy + 10.0 * y) * t) * np.exp(-10.0 * t)
    assert [each.y for each in outputs] == pytest.approx(wanted, abs=0.05 * abs(y))


def test_a_gait_that_no_servo_of_the_motor_holds_is_refused(one_step, monkeypatch):
    constraint = constraint_of(one_step)
    monkeypatch.setattr(pid, "constraint_of", lambda solution: constraint)
    frame = dataclasses.replace(one_step, params=P.replace(motor_mount="frame"))
    with pytest.raises(ValueError, match=r"motor_mount = 'frame' .* has no error.*'lqr'"):
        pid.design(frame)
    backwards = constraint._replace(authority=-1.0)
    monkeypatch.setattr(pid, "constraint_of", lambda solution: backwards)
    with pytest.raises(ValueError, match=r"moves the wheel backwards off its path.*'lqr'"):
        pid.design(one_step)


def test_the_phase_is_the_angle_that_turns_steadily():
    swinging, steady = np.array([-0.1, 1.0, 2.0]), np.array([-2.0, -3.0, -2.5])
    assert phase_of(np.array([swinging, steady])) == 1
    assert phase_of(np.array([steady, swinging])) == 0
    with pytest.raises(ValueError, match=r"slowest rate .* 0 of its mean.*at least 0.1.*'lqr'"):
        phase_of(np.array([[-0.1, 1.0], [1.0, -1.0]]))


# -- sliding mode ---------------------------------------------------------------------------------


def test_sigma_shrinks_in_every_period_and_keeps_its_sign(one_step):
    limit = P.voltage_limit
    sliding = changed(sliding_mode.design(one_step), switching_gain=0.2 * limit, layer=0.4 * limit)
    x = one_step.state(0.3) + [0.0, 0.0, 0.02, 0.0]
    visited, _, _ = path(sliding, x[None], 0.2)
    sigma = np.array([sliding_mode.sigma_now_and_later(x, sliding.data)[1] for x in visited[:, 0]])
    assert np.all(np.diff(sigma) < 0.0)
    assert 0.0 < sigma[-1] < 0.6 * sigma[0]


def test_the_sliding_modes_voltage_does_not_chatter(one_step):
    sliding = sliding_mode.design(one_step)
    visited, voltages, _ = path(sliding, one_step.state(0.2)[None], 5.0)
    nominal = [sliding_mode.sigma_now_and_later(x, sliding.data)[0] for x in visited[:, 0]]
    swings = np.abs(np.diff((voltages[:, 0] - nominal)[100:], 2))
    assert swings.max() < 0.02 * sliding.data.switching_gain
