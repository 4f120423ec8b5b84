"""Solutions are followed along a parameter, and a curve that ends early has the reason."""

from __future__ import annotations

import dataclasses
from functools import partial
from typing import Any

import numpy as np
import pytest

import trajopt.ocp.continuation
from tests.trajopt.ocp.problems import move
from trajopt.ocp.continuation import continued, distance, extrapolated
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Problem
from trajopt.ocp.solve import solve
from trajopt.ocp.transcription import Transcription


def trolley() -> Problem:
    """A trolley moves by 1 m in 1 s, from rest to rest; the least integral of u^2 is 12 / T^3."""
    return Problem((move(bounds={"v": (0.0, 3.0), "x": (0.0, 10.0)}),))


TROLLEY = trolley()


def changed(**changes: Any) -> Problem:
    phase = TROLLEY.phases[0]
    tables = {k: {**getattr(phase, k), **v} for k, v in changes.items() if isinstance(v, dict)}
    return dataclasses.replace(
        TROLLEY, phases=(dataclasses.replace(phase, **{**changes, **tables}),)
    )


def lasting(duration: float) -> Problem:
    return changed(duration=duration)


def slower_than(speed: float) -> Problem:
    return changed(bounds={"v": (0.0, speed)})


@pytest.fixture(scope="module")
def start() -> Extremal:
    return solve(TROLLEY)


def test_a_solution_is_followed_to_the_goal(start: Extremal) -> None:
    curve = continued(lasting, start, (1.0, 3.0), verify=False)
    assert curve.reached
    assert (curve.values[0], curve.values[-1]) == (1.0, 3.0)
    assert [each.cost for each in curve.solutions] == pytest.approx(
        [12.0 / T**3 for T in curve.values]
    )
    assert all(solution.converged for solution in curve.solutions)


def test_all_values_asked_for_are_met_and_steps_are_no_longer_than_allowed(
    start: Extremal,
) -> None:
    curve = continued(lasting, start, (1.0, 1.5, 1.2), step=0.2, verify=False)
    assert curve.values == pytest.approx((1.0, 1.2, 1.4, 1.5, 1.3, 1.2))
    assert curve.values[3] == 1.5
    assert [each.cost for each in curve.solutions] == pytest.approx(
        [12.0 / T**3 for T in curve.values]
    )


@pytest.mark.parametrize(("goal", "step"), [(1.6, 0.2), (0.7, 0.1)])
def test_no_step_is_as_short_as_rounding(start: Extremal, goal: float, step: float) -> None:
    curve = continued(lasting, start, (1.0, goal), step=step, verify=False, passes=0)
    assert np.diff(curve.values) == pytest.approx(
        np.full(round(abs(goal - 1) / step), np.copysign(step, goal - 1))
    )
    assert curve.reached


def test_a_curve_that_ends_early_says_why(start: Extremal) -> None:
    curve = continued(slower_than, start, (3.0, 0.5), verify=False, passes=0)
    assert not curve.reached
    assert curve.obstacle is not None
    assert 1.0 <= curve.values[-1] < 1.05
    assert curve.values[-1] - curve.obstacle.value < 2.5 / 100
    assert "violated" in curve.obstacle.reason
    assert list(curve.values) == sorted(curve.values, reverse=True)


def test_no_step_is_tried_that_is_shorter_than_the_shortest_allowed(start: Extremal) -> None:
    curve = continued(slower_than, start, (3.0, 0.5), shortest=0.5, verify=False, passes=0)
    assert curve.obstacle is not None
    assert 0.5 <= curve.values[-1] - curve.obstacle.value < 1.0


def test_bounds_that_contradict_each_other_are_an_obstacle(start: Extremal) -> None:
    def away(far: float) -> Problem:
        return changed(bounds={"x": (0.0, 1.5)}, end={"x": far})

    curve = continued(away, start, (1.0, 2.0), verify=False)
    assert curve.obstacle is not None
    assert curve.obstacle.attempt is None
    assert "widen" in curve.obstacle.reason
    assert curve.values[-1] == pytest.approx(1.5, abs=0.01)


def test_a_step_that_leads_elsewhere_is_not_taken(
    start: Extremal, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trajopt.ocp.continuation, "MOST_JUMP", 1e-9)
    curve = continued(slower_than, start, (3.0, 1.2), verify=False, passes=0)
    assert curve.obstacle is not None
    assert "a jump" in curve.obstacle.reason


def test_a_jump_is_measured_from_the_extrapolated_solution(start: Extremal) -> None:
    moved = [solve(lasting(T), start.phases, verify=False).phases for T in (1.0, 1.1, 1.2)]
    predicted = extrapolated(moved[0], moved[1], 1.0)
    assert predicted[0].duration == pytest.approx(1.2)
    far = partial(distance, scales=start.scales)
    assert far(predicted, moved[2]) < 0.3 * far(moved[1], moved[2])
    assert far(moved[0], moved[0]) == 0.0


def count_transcriptions(monkeypatch: pytest.MonkeyPatch) -> list[Problem]:
    made: list[Problem] = []

    def counted(problem: Problem, mesh: Mesh) -> Transcription:
        made.append(problem)
        return Transcription(problem, mesh)

    monkeypatch.setattr(trajopt.ocp.continuation, "Transcription", counted)
    return made


def test_problems_of_the_same_functions_share_a_transcription(
    start: Extremal, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = count_transcriptions(monkeypatch)
    curve = continued(lasting, start, (1.0, 1.5), step=0.25, verify=False)
    assert len(curve.values) == 3
    assert len(made) == 1


def test_problems_traced_anew_are_transcribed_anew(
    start: Extremal, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = count_transcriptions(monkeypatch)

    def stronger(by: float) -> Problem:
        phase = trolley().phases[0]
        function = phase.flow
        flow = dataclasses.replace(phase, flow=lambda x, u, p: by * function(x, u, p))
        return Problem((flow,))

    curve = continued(stronger, start, (1.0, 1.5), step=0.25, verify=False)
    assert curve.reached
    assert len(made) == 3
