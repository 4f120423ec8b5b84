"""The study of changed machines: which machines walk, and with what their walks are compared."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from rimless_gym import BUILDABLE
from scripts.studies import robustness
from trajopt import periodic_gait
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


def test_a_walk_is_compared_with_its_machines_optimum_at_its_speed():
    """Between whole control periods the optimum changes with speed as the nominal machine's."""
    front, longer = robustness.one_step_front(), BUILDABLE.replace(leg_length=0.301)
    speed = BUILDABLE.step_length / 0.46
    exact = robustness.Walk(BUILDABLE, speed, 1.1 * front(speed))
    faster = robustness.Walk(BUILDABLE, 1.004 * speed, 1.2 * front(1.004 * speed))
    fell = robustness.Walk(longer, math.nan, math.nan)
    costs = {(BUILDABLE, 46): front(speed)}
    assert faster.ticks == exact.ticks == 46
    case = robustness.Variation((BUILDABLE, BUILDABLE, longer))
    walks = {("some", "lqr 46"): [exact, faster, fell]}
    text = robustness.table({"some": case}, ["lqr 46"], walks, costs)
    assert "some (3) | +15.0 % (67 %)" in text


def test_a_walk_between_two_optima_is_compared_with_what_lies_between_them():
    """Half way between whole periods the reference changes, by next to nothing."""
    costs = {
        (BUILDABLE, n): periodic_gait(BUILDABLE, step_time=n / 100, progress=False).cot
        for n in (46, 47)
    }
    middle = math.sqrt(math.prod(costs.values()))
    case = robustness.Variation((BUILDABLE,))
    for ticks in (46.499, 46.501):
        walk = robustness.Walk(BUILDABLE, BUILDABLE.step_length / (ticks / 100), 1.1 * middle)
        text = robustness.table({"some": case}, ["lqr 46"], {("some", "lqr 46"): [walk]}, costs)
        (gap,) = re.findall(r"\| ([+\d.]+) % \(100 %\)", text)
        assert float(gap) == pytest.approx(10.0, abs=0.31)


def test_machines_walk_side_by_side_as_they_do_alone(tmp_path):
    machines = robustness.cases(3, 1)["drawn"]["all within 1 %"].machines
    task = robustness.CaseWalks("evolution", 0, machines, None, 16.0, tmp_path)
    together = robustness.walked(task)
    alone = robustness.walked(task._replace(machines=machines[:1]))
    assert together["speed"].shape == (3,)
    for name in ("speed", "cot"):
        assert together[name][0] == pytest.approx(alone[name][0])
        assert len(set(together[name])) == 3
