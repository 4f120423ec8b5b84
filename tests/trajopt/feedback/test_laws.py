from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.energy import ROW
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from trajopt.feedback.closed_loop import multipliers
from trajopt.feedback.constraint import constraint_of, output, phase_of
from trajopt.feedback.laws import input_output, pid, sliding_mode
from trajopt.feedback.orbit import mean_voltage, squared_distances
from trajopt.feedback.zero_dynamics import zero_dynamics_multiplier

P = THESIS_PHYSICAL
LAWS = [pid, input_output, sliding_mode]


@pytest.fixture(scope="module", params=LAWS, ids=lambda law: law.__name__.split(".")[-1])
def law(request, one_step):
    return request.param.design(one_step)


def walk(law, x, seconds):
    """The states (ticks, N, 4), the voltages (ticks, N) and the steps (N,)."""
    states = np.zeros((len(x), STATE_SIZE))
    states[:, :4] = x
    path, voltages, steps = [], [], np.zeros(len(x))
    for _ in range(round(seconds / 0.01)):
        path.append(states[:, :4].copy())
        voltages.append(law(path[-1]))
        out = advance(P, states, voltages[-1])
        assert not out[:, ROW.failure].any()
        steps += out[:, ROW.steps]
    return np.array(path), np.array(voltages), steps


def distances(law, states):
    return np.sqrt(squared_distances(np.ascontiguousarray(states), law.data.orbit))


def test_a_law_holds_its_gait(law, one_step):
    x = one_step.state(np.linspace(0.1, 0.75, 3))
    path, _, steps = walk(law, x, 8.0)
    assert np.all(abs(steps - 8.0 / one_step.duration) < 1.5)
    assert distances(law, path[400:].reshape(-1, 4)).max() < 0.1


def test_on_the_gait_a_law_plays_the_gaits_own_voltage(law, one_step):
    t = np.linspace(0.03, one_step.duration - 0.03, 201)
    wanted = mean_voltage(one_step, t, 0.01)
    assert np.abs(law(one_step.state(t)) - wanted).max() < 0.05


def test_a_small_deviation_across_the_gait_decays(law, one_step):
    assert multipliers(law, one_step)[0] < 0.9


def test_a_deviation_that_is_not_small_decays_too(law, one_step):
    x = one_step.state(0.4) + [[0.0, 0.0, 0.1, 0.0], [0.0, 0.0, 0.0, -0.2]]
    path, _, _ = walk(law, x, 5 * one_step.duration)
    assert np.all(distances(law, path[-1]) < 0.8 * distances(law, path[0]))


def test_a_law_does_not_see_whole_turns_of_the_pendulum(law, one_step):
    x = one_step.state(np.linspace(0.0, 0.8, 20)) + 0.01
    assert np.allclose(law(x), law(x + [0, 2 * np.pi, 0, 0]))


@pytest.mark.slow
def test_the_motion_along_the_constraint_is_what_the_zero_dynamics_predict(one_step):
    predicted = zero_dynamics_multiplier(one_step)
    measured = multipliers(input_output.design(one_step), one_step)
    assert 0.0 < predicted < 1.0
    assert measured[0] == pytest.approx(predicted, rel=0.1)


def test_no_gain_of_the_input_output_law_changes_the_motion_along_the_constraint(one_step):
    first, second = (
        multipliers(input_output.design(one_step, kp=rate**2, kd=2 * rate), one_step)[0]
        for rate in (20.0, 40.0)
    )
    assert first == pytest.approx(second, rel=0.05)


def test_the_output_decays_as_its_equation_says(one_step):
    law = input_output.design(one_step, kp=100.0, kd=20.0)
    x = one_step.state(0.2) + [0.001, 0.0, 0.0, 0.0]
    path, _, _ = walk(law, x[None], 0.31)
    found = [output(state, law.data.constraint, P.constants) for state in path[:, 0]]
    t = 0.01 * np.arange(len(found))
    y, dy = found[0].y, found[0].dy
    wanted = (y + (dy + 10.0 * y) * t) * np.exp(-10.0 * t)
    assert [each.y for each in found] == pytest.approx(wanted, abs=0.05 * abs(y))


def test_sigma_shrinks_in_every_period_and_keeps_its_sign(one_step):
    law = sliding_mode.design(one_step, reach=0.2, layer=0.4)
    x = one_step.state(0.3) + [0.0, 0.0, 0.02, 0.0]
    path, _, _ = walk(law, x[None], 0.2)
    sigma = np.array([sliding_mode.sigma_now_and_later(state, law.data)[1] for state in path[:, 0]])
    assert np.all(np.diff(sigma) < 0.0)
    assert 0.0 < sigma[-1] < 0.6 * sigma[0]


def test_the_sliding_modes_voltage_does_not_chatter(one_step):
    law = sliding_mode.design(one_step)
    path, voltages, _ = walk(law, one_step.state(0.2)[None], 5.0)
    own = [sliding_mode.sigma_now_and_later(state, law.data)[0] for state in path[:, 0]]
    excess = voltages[:, 0] - own
    swings = np.abs(np.diff(excess[100:], 2))
    assert swings.max() < 0.02 * law.data.reach


@pytest.mark.parametrize(
    ("law", "gains", "message"),
    [
        (pid, {"kp": 0.0}, r"kp = 0.0: must be greater than 0"),
        (pid, {"kd": -1.0}, r"kd = -1.0: must be at least 0"),
        (input_output, {"kd": 200.0}, r"kd = 200.0: must be less than 200"),
        (input_output, {"kp": 2e4, "kd": 100.0}, r"kp = 20000.0: must be less than 20000"),
        (sliding_mode, {"layer": -1.0}, r"layer = -1.0: must be greater than 0"),
        (sliding_mode, {"reach": 2.0}, r"reach = 2.0: must be at most layer = 0.7"),
        (sliding_mode, {"effort": np.nan}, r"effort = nan: must be finite"),
    ],
)
def test_gains_out_of_range_are_refused_with_name_value_and_limit(law, gains, message, one_step):
    with pytest.raises(ValueError, match=message):
        law.design(one_step, **gains)


def test_a_motor_whose_angle_is_the_phase_has_nothing_to_correct(one_step, monkeypatch):
    constraint = constraint_of(one_step)
    monkeypatch.setattr(pid, "constraint_of", lambda solution: constraint)
    frame = dataclasses.replace(one_step, params=P.replace(motor_mount="frame"))
    with pytest.raises(ValueError, match=r"motor_mount = 'frame' .* has no error.*'lqr'"):
        pid.design(frame)


def test_a_gait_that_a_servo_of_the_motor_drives_away_is_refused(one_step, monkeypatch):
    backwards = constraint_of(one_step)._replace(authority=-1.0)
    monkeypatch.setattr(pid, "constraint_of", lambda solution: backwards)
    with pytest.raises(ValueError, match=r"moves the wheel backwards off its path.*'lqr'"):
        pid.design(one_step)


def test_the_phase_is_the_angle_that_turns_steadily():
    swinging, steady = np.array([-0.1, 1.0, 2.0]), np.array([-2.0, -3.0, -2.5])
    assert phase_of(np.array([swinging, steady])) == 1
    assert phase_of(np.array([steady, swinging])) == 0


def test_a_gait_on_which_both_angles_stand_still_is_refused():
    with pytest.raises(ValueError, match=r"slowest rate .* 0 of its mean.*at least 0.1.*'lqr'"):
        phase_of(np.array([[-0.1, 1.0], [1.0, -1.0]]))
