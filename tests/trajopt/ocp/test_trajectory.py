"""Trajectories between their nodes, and at their edges."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from trajopt.ocp.continuation import extrapolated
from trajopt.ocp.trajectory import PhaseTrajectory

ENDS = np.array([0.0, 1.0])
EDGES = np.array([0.0, 0.1, 0.3, 0.7])


def stairs(edges: np.ndarray = EDGES) -> PhaseTrajectory:
    """A control of 0, 1, 2 on three elements."""
    controls = np.repeat(np.arange(3.0), 2).reshape(3, 2, 1)
    return PhaseTrajectory(edges, ENDS, np.zeros((3, 2, 1)), ENDS, controls)


@pytest.mark.parametrize("rounding", [-1e-16, 0.0, 1e-16])
def test_at_an_edge_the_control_is_that_of_the_side_asked_for(rounding: float) -> None:
    at = EDGES * (1 + rounding * np.array([1, 4, 4, 4]))
    assert stairs().control(at)[:, 0] == pytest.approx([0, 1, 2, 2])
    assert stairs().control(at, "left")[:, 0] == pytest.approx([0, 0, 1, 2])


def test_close_to_an_edge_both_sides_are_the_same() -> None:
    for side in ("left", "right"):
        assert stairs().control(EDGES[1:3] - 1e-9, side)[:, 0] == pytest.approx([0, 1])
        assert stairs().control(EDGES[1:3] + 1e-9, side)[:, 0] == pytest.approx([1, 2])


@pytest.mark.parametrize("stretch", [1.0, 1.1, 1.3, 1.7])
def test_a_control_that_jumps_is_extrapolated_on_either_side_of_its_jump(stretch: float) -> None:
    """Stairs, and the same ones a half higher in another time: the next are one higher."""
    before, after = stairs(), stairs(stretch * EDGES)
    after = dataclasses.replace(after, controls=after.controls + 0.5)
    (found,) = extrapolated([before], [after], 1.0)
    assert found.controls == pytest.approx(before.controls + 1.0)
