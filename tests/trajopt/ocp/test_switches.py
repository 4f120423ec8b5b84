"""Jumps, kinks and switches of a control are found where they are, whatever the rounding."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from tests.trajopt.ocp.motions import block, sampled
from trajopt import PhaseTrajectory
from trajopt.ocp.refinement import breaks, is_smooth, switch_points

NONE = np.zeros(0)


@pytest.mark.parametrize("place", [0.3, 0.42])
def test_a_jump_is_found_where_the_mean_control_says(place: float) -> None:
    t = np.linspace(0.0, 1.0, 5)
    jumping = sampled(t, lambda t: np.where(t < place, 1.0, -1.0), degree=4)
    mean = 1 - 2 * (place - 0.25) / 0.25  # of the element, from 1 to -1
    controls = jumping.controls.copy()
    controls[1] = -mean
    found = breaks(dataclasses.replace(jumping, controls=controls), 1)
    assert found == [pytest.approx((place - 0.25) / 0.25)]


def test_a_kink_is_found_where_the_neighbours_meet() -> None:
    kinked = sampled(np.linspace(0.0, 1.0, 5), lambda t: np.maximum(0.42 - t, 0.0))
    assert breaks(kinked, 1) == [pytest.approx((0.42 - 0.25) / 0.25)]
    assert breaks(kinked, 0) == []
    assert breaks(kinked, 3) == []


def test_a_jump_close_to_an_edge_is_cut_off_together_with_a_margin() -> None:
    t = np.linspace(0.0, 1.0, 5)
    jumping = sampled(t, lambda t: np.where(t < 0.3, 1.0, -1.0), degree=4)
    controls = jumping.controls.copy()
    controls[1] = -1 + 2 * 0.03
    assert breaks(dataclasses.replace(jumping, controls=controls), 1) == [pytest.approx(0.06)]


def test_a_power_that_changes_sign_switches() -> None:
    trajectory = sampled([0.0, 0.5, 1.0], lambda t: 0.5 - t + 0.1)
    assert switch_points(block(), trajectory, 1, NONE) == [pytest.approx(0.2)]
    assert switch_points(block(), trajectory, 0, NONE) == []


@pytest.mark.parametrize("force", [(-1.0, 1.0), (-math.inf, 1.0), (-2.0, math.inf)])
def test_a_bound_that_is_met_switches_whether_or_not_there_is_another(
    force: tuple[float, float],
) -> None:
    phase = dataclasses.replace(block(), powers=None, bounds={"u": force})
    bound = 1.0 if force[1] == 1.0 else force[0]
    saturating = sampled([0.0, 0.5, 1.0], lambda t: bound * np.minimum(t / 0.7, 1.0), degree=2)
    assert len(switch_points(phase, saturating, 1, NONE)) == 1
    assert switch_points(phase, saturating, 0, NONE) == []


def _twice(trajectory: PhaseTrajectory) -> PhaseTrajectory:
    """With a second control equal to the first, and after it another that breaks elsewhere."""
    u = trajectory.controls
    return dataclasses.replace(trajectory, controls=np.concatenate([u, -u, u[::-1, ::-1]], axis=-1))


EDGES = np.linspace(0.0, 1.0, 5)
BRINKS = {
    "a kink in the neighbour": sampled(EDGES, lambda t: np.maximum(0.42 - t, 0.0)),
    "a kink at an edge": sampled(EDGES, lambda t: np.abs(t - 0.5)),
    "a bump": sampled(EDGES, lambda t: np.where((t > 0.5) & (t < 0.75), np.sin(4 * np.pi * t), 0)),
    "constant": sampled(EDGES, lambda t: np.full_like(t, 0.3)),
    "at its bound": sampled(EDGES, lambda t: np.ones_like(t)),
    "at rest": sampled(EDGES, lambda t: np.zeros_like(t)),
    "at rest in between": sampled(EDGES, lambda t: np.where((t > 0.25) & (t <= 0.75), 0, t - 0.5)),
    "through zero at a sample": sampled(EDGES, lambda t: 0.6 - t),
    "through zero at an edge": sampled(EDGES, lambda t: 0.5 - t),
    "near an edge": sampled(EDGES, lambda t: np.where(t < 0.275, 1.0, -1.0), degree=4),
    "equal controls": _twice(sampled(EDGES, lambda t: np.maximum(0.42 - t, 0.0))),
}


@pytest.mark.parametrize("brink", BRINKS)
def test_decisions_do_not_depend_on_rounding(brink: str) -> None:
    trajectory, rng = BRINKS[brink], np.random.default_rng(0)
    controls = tuple(f"u{k}" for k in range(trajectory.controls.shape[-1]))
    phase = dataclasses.replace(block(), controls=controls, bounds=dict.fromkeys(controls, (-1, 1)))

    def decisions(seen: PhaseTrajectory) -> list[object]:
        return [
            (breaks(seen, e), switch_points(phase, seen, e, NONE), is_smooth(seen, e))
            for e in range(4)
        ]

    def shaken(values: np.ndarray) -> np.ndarray:
        return values + rng.choice([0.0, 1e-16, 1e-13]) * rng.uniform(-1.0, 1.0, values.shape)

    undisturbed = decisions(trajectory)
    for _ in range(20):
        states, controls = shaken(trajectory.states), shaken(trajectory.controls)
        disturbed = decisions(dataclasses.replace(trajectory, states=states, controls=controls))
        for (jumps, switches, smooth), others in zip(undisturbed, disturbed, strict=True):
            assert (pytest.approx(jumps), pytest.approx(switches), smooth) == others


def test_a_solution_that_a_few_more_degrees_resolve_is_smooth() -> None:
    edges = [0.0, 0.5, 1.0]
    assert is_smooth(sampled(edges, np.sin, 8), 0)
    assert is_smooth(sampled(edges, lambda t: 0 * t, 8), 0)
    assert not is_smooth(sampled(edges, lambda t: np.abs(t - 0.2), 8), 0)
    assert not is_smooth(sampled(edges, lambda t: np.sign(t - 0.2), 8), 0)
