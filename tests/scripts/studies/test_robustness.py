"""The study of changed machines: which machines walk, and with what their walks are compared."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rimless_gym import BUILDABLE
from rimless_gym.envs.layout import observe
from rimless_gym.hybrid import motor_voltage
from scripts.studies import robustness
from trajopt.identification.fit import PHYSICAL


def changes(machine):
    """Each physical parameter's change, as a share of the nominal one."""
    return np.array([getattr(machine, name) / getattr(BUILDABLE, name) - 1 for name in PHYSICAL])


def test_the_same_machines_are_drawn_for_all_levels_and_more_leave_these_as_they_are():
    drawn, more = (robustness.cases(n, 2)["drawn"] for n in (3, 5))
    assert drawn["all within 0 %"].machines == (BUILDABLE,) * 2
    half, two = (map(changes, drawn[f"all within {level} %"].machines) for level in ("0.5", "2"))
    for a, b in zip(half, two, strict=True):
        assert 0.01 < np.abs(b).max() < 0.02
        np.testing.assert_allclose(4 * a, b, atol=1e-12)
    assert more["all within 2 %"].machines[:3] == drawn["all within 2 %"].machines


def test_all_walks_of_a_case_are_in_parts_whose_machines_differ(monkeypatch, tmp_path):
    monkeypatch.setattr(robustness, "TOGETHER", 2)
    case = robustness.cases(5, 1)["drawn"]["all within 1 %"]
    parts = robustness.walks_of(case, "lqr 46", 28.0, tmp_path)
    assert [part.first for part in parts] == [0, 2, 4]
    assert sum((part.machines for part in parts), ()) == case.machines


def test_a_walk_is_compared_with_its_machines_own_optima_on_both_sides_of_its_speed():
    longer = BUILDABLE.replace(leg_length=0.301)

    def walk(ticks, cot, machine=BUILDABLE):
        return robustness.Walk(machine, machine.step_length / (ticks / 100), cot)

    costs = {(BUILDABLE, 45): None, (BUILDABLE, 46): 0.05, (BUILDABLE, 47): 0.04}
    costs |= dict.fromkeys([(longer, 46), (longer, 47)])
    several = [walk(46.5, 1.2 * 0.045), walk(46.25, 1.1 * 0.0475), walk(45.7, 1.3 * 0.05)]
    several += [walk(46.5, 0.1, longer), walk(math.nan, math.nan)]
    case = robustness.Variation(tuple(each.machine for each in several))
    text = robustness.table({"some": case}, ["lqr 46"], {("some", "lqr 46"): several}, costs)
    assert "some (5) | +20.0 % (80 %)" in text


def test_machines_walk_side_by_side_as_they_do_alone(tmp_path):
    machines = robustness.cases(3, 1)["drawn"]["all within 1 %"].machines
    task = robustness.CaseWalks("evolution", 0, machines, None, 16.0, tmp_path)
    together = robustness.walked(task)
    alone = robustness.walked(task._replace(machines=machines[:1]))
    assert together["speed"].shape == (3,)
    for name in ("speed", "cot"):
        assert together[name][0] == pytest.approx(alone[name][0])
        assert len(set(together[name])) == 3


def test_with_play_the_pendulum_is_read_ahead_of_the_motors_torque():
    """Of three wheels whose pendulums turn at 4 rad/s, the second falls; the third's motor differs.

    Its larger constant has a back-EMF above 2 V, and the others' is below.
    """
    read, rate = [], 4.0
    machines = (BUILDABLE, BUILDABLE, BUILDABLE.replace(motor_constant=0.03))
    states = np.zeros((3, 6))
    states[:, 0], states[:, 3] = 0.5 * np.pi, rate
    assert motor_voltage(rate, 0.0, BUILDABLE.constants) < 2.0
    assert motor_voltage(rate, 0.0, machines[2].constants) > 2.0

    def policy(states, observations):
        read.append(states)
        return np.full(len(states), 2.0 / BUILDABLE.voltage_limit)

    rows = [0, 1, 2]
    reading = robustness.WithPlay(policy).begin(machines, lambda: np.array(rows))
    reading(states[rows], observe(BUILDABLE, states[rows]))
    rows.remove(1)
    reading(states[rows], observe(BUILDABLE, states[rows]))
    np.testing.assert_allclose(read[0][:, 1], [-0.5 * robustness.PLAY] * 3)  # no voltage yet
    np.testing.assert_allclose(read[1][:, 1], [0.5 * robustness.PLAY, -0.5 * robustness.PLAY])
