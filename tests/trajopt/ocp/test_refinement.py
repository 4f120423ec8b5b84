"""Meshes become finer where they should; switches of a control are found whatever the rounding."""

from __future__ import annotations

import dataclasses
import importlib
import math
from collections.abc import Sequence

import numpy as np
import pytest

from scripts.studies import textbook
from tests.trajopt.ocp.problems import NONE, block, ones, sampled, solve_once
from trajopt import Mesh, Phase, PhaseTrajectory, Problem, solve
from trajopt.ocp import refinement
from trajopt.ocp.accuracy import Quality
from trajopt.ocp.refinement import (
    Tolerances,
    breaks,
    certified,
    is_smooth,
    refined,
    switch_points,
)


def quality(elements: int, **wrong: dict[int, float]) -> Quality:
    """Without fault but for errors {element: size}."""
    parts = {name: np.zeros(elements) for name in vars(_FAULTLESS)}
    for name, errors in wrong.items():
        for element, size in errors.items():
            parts[name][element] = size
    parts["path_violation"] = parts["path_violation"][:, None]
    return Quality(**parts)


_FAULTLESS = Quality(*(NONE for _ in dataclasses.fields(Quality)))


UNITS = ones(Problem((block(),)).phases[0])


def refine(
    trajectory: PhaseTrajectory,
    faults: Quality,
    mesh: Mesh,
    wanted: Sequence[tuple[int, float]] = (),
) -> Mesh:
    tolerances = Tolerances(states=1e-7, cost=1e-6, limits=1e-6)
    where = mesh, Problem((block(),)), [trajectory], NONE
    switches = [np.array(wanted).reshape(-1, 2)]
    return refined(*where, [UNITS], [faults], switches, tolerances)


@pytest.fixture
def smooth() -> PhaseTrajectory:
    return sampled([0.0, 0.25, 0.5, 0.75, 1.0], lambda t: 0.5 * np.sin(t))


def test_a_mesh_without_fault_is_kept(smooth: PhaseTrajectory) -> None:
    mesh = Mesh.uniform(1, 4, 6)
    assert refine(smooth, quality(4), mesh) == mesh


def test_an_element_is_split_once_where_several_switches_are_wanted_at_one_place() -> None:
    constant = sampled([0.0, 0.25, 0.5, 0.75, 1.0], lambda t: 0.5 + 0.0 * t)
    wanted = [(1, 0.8), (1, 0.4), (1, 0.4 + 1e-9), (1, 0.4), (1, 1e-4), (2, 0.5)]
    mesh = refine(constant, quality(4, cost_gap={1: 1e-4}), Mesh.uniform(1, 4, 6), wanted)
    assert mesh.fractions[0] == pytest.approx((0.0, 0.25, 0.35, 0.45, 0.5, 0.75, 1.0))


@pytest.mark.parametrize(("error", "degree"), [(2e-7, 7), (5e-6, 8), (2e-4, 10)])
def test_the_degree_rises_where_the_solution_is_smooth_and_only_there(
    smooth: PhaseTrajectory, error: float, degree: int
) -> None:
    mesh = refine(smooth, quality(4, step_error={1: error}), Mesh.uniform(1, 4, 6))
    assert mesh.degrees == ((6, degree, 6, 6),)
    assert mesh.fractions == Mesh.uniform(1, 4).fractions


@pytest.mark.parametrize(
    ("fault", "size"),
    [("limit_violation", 2e-6), ("path_violation", 2e-3), ("step_error", 1.0)],
)
def test_elements_that_break_a_limit_or_ask_for_too_high_a_degree_are_halved(
    smooth: PhaseTrajectory, fault: str, size: float
) -> None:
    mesh = refine(smooth, quality(4, **{fault: {2: size}}), Mesh.uniform(1, 4, 6))
    assert mesh.fractions == ((0.0, 0.25, 0.5, 0.625, 0.75, 1.0),)
    assert mesh.degrees == ((6,) * 5,)


@pytest.mark.parametrize("scheme", ["trapezoid", "hermite-simpson"])
def test_elements_of_a_fixed_degree_are_always_halved(smooth: PhaseTrajectory, scheme: str) -> None:
    mesh = Mesh.uniform(1, 4, scheme=scheme)
    finer = refine(smooth, quality(4, step_error={0: 1e-5}), mesh)
    assert finer.fractions == ((0.0, 0.125, 0.25, 0.5, 0.75, 1.0),)


def test_the_caps_on_elements_and_on_their_length_hold(
    smooth: PhaseTrajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    everywhere = quality(4, limit_violation=dict.fromkeys(range(4), 1.0))
    monkeypatch.setattr(refinement, "MAX_ELEMENTS", 6)
    assert refine(smooth, everywhere, Mesh.uniform(1, 4, 6)).elements == 6
    monkeypatch.setattr(refinement, "MAX_ELEMENTS", 4)
    assert refine(smooth, everywhere, Mesh.uniform(1, 4, 6)) == Mesh.uniform(1, 4, 6)
    short = Mesh(((0.0, 5e-6, 0.5, 0.75, 1.0),), ((6,) * 4,))
    monkeypatch.setattr(refinement, "MAX_ELEMENTS", 400)
    assert refine(smooth, everywhere, short).fractions[0][:3] == (
        0.0,
        5e-6,
        pytest.approx(0.25, abs=1e-5),
    )


def test_where_there_is_no_room_for_all_the_worst_are_split(
    smooth: PhaseTrajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(refinement, "MAX_ELEMENTS", 5)
    faults = quality(4, limit_violation={0: 1e-5, 1: 1e-4, 2: 1e-2, 3: 1e-3})
    mesh = refine(smooth, faults, Mesh.uniform(1, 4, 6))
    assert mesh.fractions == ((0.0, 0.25, 0.5, 0.625, 0.75, 1.0),)
    faults = quality(4, limit_violation={0: 1e-3, 1: 1e-4, 2: 1e-5, 3: 1e-2})
    mesh = refine(smooth, faults, Mesh.uniform(1, 4, 6))
    assert mesh.fractions == ((0.0, 0.25, 0.5, 0.75, 0.875, 1.0),)


def test_a_wasteful_element_is_split_at_its_jump() -> None:
    t = np.linspace(0.0, 1.0, 5)
    jumping = sampled(t, lambda t: np.where(t < 0.35, 1.0, -1.0), degree=4)
    controls = jumping.controls.copy()
    controls[1] = -1 + 2 * 0.4
    trajectory = dataclasses.replace(jumping, controls=controls)
    mesh = refine(trajectory, quality(4, cost_gap={1: 1e-3, 3: 1e-3}), Mesh.uniform(1, 4))
    assert mesh.fractions == (pytest.approx((0.0, 0.25, 0.35, 0.5, 0.75, 1.0)),)


def test_of_equally_bad_elements_the_first_are_split(
    smooth: PhaseTrajectory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(refinement, "MAX_ELEMENTS", 5)
    for hair in (-1e-12, 0.0, 1e-12):
        faults = quality(4, limit_violation={0: 1e-5, 1: 1e-3, 3: 1e-3 * (1 + hair)})
        mesh = refine(smooth, faults, Mesh.uniform(1, 4, 6))
        assert mesh.fractions == ((0.0, 0.25, 0.375, 0.5, 0.75, 1.0),)


def test_elements_of_one_width_are_all_split_or_none() -> None:
    mesh = Mesh.uniform(1, 1000)
    assert len(set(np.diff(mesh.fractions[0]))) > 1  # by rounding
    hamiltonian = np.tile([0.0, 1.0], (1000, 1))
    assert certified(mesh, [hamiltonian], np.ones(1), 1e-3) == mesh
    finer = certified(Mesh.uniform(1, 900), [hamiltonian[:900]], np.ones(1), 1e-3)
    assert finer.elements == 1800


def test_a_bang_bang_control_needs_few_meshes() -> None:
    problem = textbook.fastest_move(brake=2.0)
    coarse = solve_once(problem, mesh=Mesh.uniform(problem, 7))
    assert coarse.cost > textbook.fastest_move_time(brake=2.0) * (1 + 1e-4)
    found = solve(problem, mesh=Mesh.uniform(problem, 7))
    assert len(found.attempts) <= 4
    assert found.cost == pytest.approx(textbook.fastest_move_time(brake=2.0), rel=1e-7)
    switch = found.cost * 2 / 3
    assert np.abs(found.phases[0].edges - switch).min() < 1e-4 * found.cost


def test_a_long_problem_with_two_boundary_layers_gets_its_elements_there() -> None:
    """The hypersensitive problem of Rao and Mease: at rest but for its ends."""
    decay = Phase(
        "decay",
        states=("x",),
        controls=("u",),
        flow=lambda x, u, p: (u - x**3,),
        cost=lambda x, u, p: 0.5 * (x**2 + u**2),
        start={"x": 1.0},
        end={"x": 1.5},
        duration=1000.0,
    )
    found = solve(Problem((decay,)))
    assert found.converged, found.report()
    assert len(found.attempts) <= 10
    assert found.mesh.elements <= 30
    edges = found.phases[0].edges
    assert np.sum((edges < 20) | (edges > 980)) > 0.5 * len(edges)
    costates = found.certificate.costates[0][[0, -1], 0]
    # Nothing happens for long, so that the Hamiltonian is 0: costate^2 + 2 costate x^3 = x^2.
    x = np.array([1.0, 1.5])
    exact = -(x**3) + np.array([1.0, -1.0]) * np.sqrt(x**6 + x**2)
    assert costates == pytest.approx(exact, rel=1e-4)


def test_the_best_mesh_is_kept_when_a_finer_one_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    module, calls = importlib.import_module("trajopt.ocp.solve"), []
    refine_ = module.refined

    def recorded(mesh: Mesh, *rest: object) -> Mesh:
        calls.append(mesh)
        finer = refine_(mesh, *rest)
        return finer if len(calls) < 2 else Mesh.uniform(1, 1, 1)  # hopeless

    monkeypatch.setattr(module, "refined", recorded)
    found = solve(textbook.cart_pole(), passes=2, verify=False)
    assert found.mesh == calls[1]
    assert found.status == "Solve_Succeeded"
    assert found.failures == () or found.failures[0].startswith("mesh error")


# -- switches within an element -----------------------------------------------------------------


def test_a_jump_is_where_the_mean_control_implies() -> None:
    place = 0.42
    t = np.linspace(0.0, 1.0, 5)
    jumping = sampled(t, lambda t: np.where(t < place, 1.0, -1.0), degree=4)
    mean = 1 - 2 * (place - 0.25) / 0.25  # of the element, from 1 to -1
    controls = jumping.controls.copy()
    controls[1] = -mean
    found = breaks(dataclasses.replace(jumping, controls=controls), 1, UNITS)
    assert found == [pytest.approx((place - 0.25) / 0.25)]


def test_a_kink_is_where_the_neighbours_meet() -> None:
    kinked = sampled(np.linspace(0.0, 1.0, 5), lambda t: np.maximum(0.42 - t, 0.0))
    assert breaks(kinked, 1, UNITS) == [pytest.approx((0.42 - 0.25) / 0.25)]
    assert breaks(kinked, 0, UNITS) == []
    assert breaks(kinked, 3, UNITS) == []


def test_a_jump_close_to_an_edge_is_cut_off_together_with_a_margin() -> None:
    t = np.linspace(0.0, 1.0, 5)
    jumping = sampled(t, lambda t: np.where(t < 0.3, 1.0, -1.0), degree=4)
    controls = jumping.controls.copy()
    controls[1] = -1 + 2 * 0.03
    assert breaks(dataclasses.replace(jumping, controls=controls), 1, UNITS) == [
        pytest.approx(0.06)
    ]


def test_a_power_that_changes_sign_switches() -> None:
    trajectory = sampled([0.0, 0.5, 1.0], lambda t: 0.5 - t + 0.1)
    assert switch_points(block(), trajectory, 1, NONE, UNITS) == [pytest.approx(0.2)]
    assert switch_points(block(), trajectory, 0, NONE, UNITS) == []


@pytest.mark.parametrize("force", [(-1.0, 1.0), (-math.inf, 1.0), (-2.0, math.inf)])
def test_a_bound_that_is_met_switches_whether_or_not_there_is_another(
    force: tuple[float, float],
) -> None:
    phase = dataclasses.replace(block(), powers=None, bounds={"u": force})
    bound = 1.0 if force[1] == 1.0 else force[0]
    saturating = sampled([0.0, 0.5, 1.0], lambda t: bound * np.minimum(t / 0.7, 1.0), degree=2)
    assert len(switch_points(phase, saturating, 1, NONE, UNITS)) == 1
    assert switch_points(phase, saturating, 0, NONE, UNITS) == []


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

    units = dataclasses.replace(UNITS, controls=np.ones(len(controls)))

    def decisions(seen: PhaseTrajectory) -> list[object]:
        return [
            (
                breaks(seen, e, units),
                switch_points(phase, seen, e, NONE, units),
                is_smooth(seen, e, units),
            )
            for e in range(4)
        ]

    def shaken(values: np.ndarray) -> np.ndarray:
        return values + rng.choice([0.0, 1e-16, 1e-13]) * rng.uniform(-1.0, 1.0, values.shape)

    undisturbed = decisions(trajectory)
    for _ in range(8):
        states, controls = shaken(trajectory.states), shaken(trajectory.controls)
        disturbed = decisions(dataclasses.replace(trajectory, states=states, controls=controls))
        for (jumps, switches, smooth), others in zip(undisturbed, disturbed, strict=True):
            assert (pytest.approx(jumps), pytest.approx(switches), smooth) == others


def test_a_solution_that_a_few_more_degrees_resolve_is_smooth() -> None:
    edges = [0.0, 0.5, 1.0]
    assert is_smooth(sampled(edges, np.sin, 8), 0, UNITS)
    assert is_smooth(sampled(edges, lambda t: 0 * t, 8), 0, UNITS)
    assert not is_smooth(sampled(edges, lambda t: np.abs(t - 0.2), 8), 0, UNITS)
    assert not is_smooth(sampled(edges, lambda t: np.sign(t - 0.2), 8), 0, UNITS)
