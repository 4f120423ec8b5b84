"""Solutions: by time, in reports and in files."""

from __future__ import annotations

import dataclasses
import math
import pickle
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from tests.trajopt.ocp.problems import move, solve_once, solved
from trajopt import (
    Extremal,
    ExtremalFileError,
    Linkage,
    Mesh,
    Phase,
    Problem,
    equal,
    load_phases,
    nonnegative,
    solve,
)


def test_states_are_read_by_time() -> None:
    swing, ball = solved("cart pole"), solved("bouncing ball")
    assert swing.state(0.0) == pytest.approx([0, 0, 0, 0], abs=1e-9)
    assert swing.state(2.0) == pytest.approx([1, math.pi, 0, 0], abs=1e-8)
    landing = ball.phases[0].duration + ball.phases[1].duration
    for rounding in (-4e-16, 0.0, 4e-16):
        t = landing * (1 + rounding)
        assert ball.state(t, "left") == pytest.approx(ball.phases[1].end, abs=1e-9)
        assert ball.state(t, "right") == pytest.approx(ball.phases[2].start, abs=1e-9)
    for t in (-0.1, ball.duration + 0.1, math.nan, [0.1, -0.1]):
        with pytest.raises(ValueError, match=r"must be (from 0 to|finite)"):
            ball.state(t)


def test_many_times_are_read_at_once() -> None:
    ball = solved("bouncing ball")
    t = np.array([ball.duration, 0.0, 0.3 * ball.duration, 0.9 * ball.duration])
    assert np.array_equal(ball.state(t), np.stack([ball.state(each) for each in t]))
    assert ball.control(t).shape == (4, 0)


def test_a_report_says_what_there_is_to_know() -> None:
    report = solved("gear").report()
    for word in ("converged", "cost", "0.48", "radau, 10 elements", "ratio = 5", "Hamiltonian"):
        assert word in report


def test_a_plot_has_every_state_and_control_beside_its_costate_or_switching_function() -> None:
    figure = solved("fastest move").plot()
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["x", "costate of x", "v", "costate of v", "force", "dH/dforce"]
    force, switching = (axes.lines[0].get_ydata() for axes in figure.axes[-2:])
    known = ~np.isnan(force) & (np.abs(switching) > 1e-3)
    assert np.array_equal(force[known] > 0.0, switching[known] < 0.0)  # full force, then full brake


def test_solutions_survive_pickling() -> None:
    copy = pickle.loads(pickle.dumps(solved("gear")))
    assert copy.cost == solved("gear").cost
    assert copy.converged


# -- files --------------------------------------------------------------------------------------


def relay() -> Problem:
    """A trolley hands a load of mass m to another one halfway; m may be chosen.

    The cost is small, so that differences are seen in any unit.
    """
    leg = Phase(
        "first",
        states=("x", "v"),
        controls=("f",),
        flow=lambda x, u, p: [x[1], u[0] / p[0]],
        cost=lambda x, u, p: 1e-14 * (u[0] ** 2 + 1.0 / p[0]),
        bounds={"v": (0.0, 5.0)},
        start={"x": 0.0, "v": 0.0},
        end={"x": 0.5},
        duration=(0.2, 2.0),
    )
    second = dataclasses.replace(leg, name="second", start={}, end={"x": 1.0, "v": 0.0})
    link = Linkage(0, 1, map=lambda x, p: ca.vertcat(x[0], 0.9 * x[1]))
    return Problem((leg, second), (link,), parameters={"m": (0.5, 2.0)}, duration=1.5)


RELAY = relay()


@pytest.fixture(scope="module")
def extremal() -> Extremal:
    return solve(RELAY)


@pytest.fixture
def path(extremal: Extremal, tmp_path: Path) -> Path:
    extremal.save(tmp_path / "relay.npz")
    return tmp_path / "relay.npz"


def test_a_solution_is_the_same_when_it_is_loaded(extremal: Extremal, path: Path) -> None:
    loaded = Extremal.load(path, RELAY)
    assert extremal.converged
    assert loaded.report() == extremal.report()
    assert loaded.mesh == extremal.mesh
    for name in ("attempts", "violations", "audit", "resimulation", "provenance"):
        assert getattr(loaded, name) == getattr(extremal, name)
    for one, other in zip(loaded.certificate.costates, extremal.certificate.costates, strict=True):
        assert np.array_equal(one, other)
    assert np.array_equal(loaded.state(0.7), extremal.state(0.7))


@pytest.mark.parametrize("name", ["bouncing ball", "fastest move", "gear"])
def test_a_solution_with_or_without_controls_and_parameters_is_loaded(
    name: str, tmp_path: Path
) -> None:
    solved(name).save(tmp_path / "it.npz")
    assert Extremal.load(tmp_path / "it.npz", solved(name).problem).cost == solved(name).cost


def test_a_solution_that_failed_can_be_saved_too(tmp_path: Path) -> None:
    failed = solve(RELAY, passes=0, option_sets=({"max_iter": 2},), verify=False)
    failed.save(tmp_path / "failed.npz")
    loaded = Extremal.load(tmp_path / "failed.npz", RELAY)
    assert not loaded.converged
    assert loaded.failures == failed.failures
    assert loaded.resimulation is None


def test_a_loaded_trajectory_is_a_guess_on_any_mesh(extremal: Extremal, path: Path) -> None:
    mesh = Mesh.uniform(RELAY, (7, 3), 5)
    again = solve(RELAY, load_phases(path), mesh, parameters=extremal.parameters)
    assert again.cost == pytest.approx(extremal.cost, rel=1e-6, abs=0.0)


def changed(**changes: Any) -> Problem:
    """The relay with changes of its second leg."""
    first, second = RELAY.phases
    return dataclasses.replace(RELAY, phases=(first, dataclasses.replace(second, **changes)))


LINK = Linkage(0, 1, map=lambda x, p: ca.vertcat(x[0], 0.8 * x[1]))
OTHERS = {
    "names": Problem((RELAY.phases[0],), parameters={"m": 1.0}),
    "an end": changed(end={"x": 1.1, "v": 0.0}),
    "a bounded parameter": dataclasses.replace(RELAY, parameters={"m": (0.5, 3.0)}),
    "a boundary": dataclasses.replace(
        RELAY, boundary=equal(lambda s, e, d, p: d[0] - d[1], [0.0], "halves")
    ),
    "what a parameter does": changed(flow=lambda x, u, p: [x[1], u[0] / p[0] ** 2]),
    "a flow far away": changed(flow=lambda x, u, p: [x[1], u[0] / p[0] + ca.fmax(x[0] - 2, 0)]),
    "a path": changed(path=nonnegative(lambda x, u, p: 9.0 - u[0], "force")),
    "a reset": dataclasses.replace(RELAY, linkages=(LINK,)),
    "an offset": dataclasses.replace(
        RELAY, linkages=(dataclasses.replace(RELAY.linkages[0], offset={"x": 0.1}),)
    ),
}


@pytest.mark.parametrize("change", OTHERS)
def test_a_solution_of_another_problem_is_refused(path: Path, change: str) -> None:
    with pytest.raises(ExtremalFileError, match=r"another problem .* other (names|bounds)"):
        Extremal.load(path, OTHERS[change])


def test_the_same_problem_traced_anew_is_accepted(path: Path) -> None:
    assert Extremal.load(path, relay()).converged


def test_a_problem_is_the_same_where_its_functions_are_rounded_otherwise(tmp_path: Path) -> None:
    """The solution satisfies the equation, so that its last digits are all that is left of it."""

    def reaching(rounding: float) -> Problem:
        at_end = equal(lambda x, p: ca.sin(x[0]) + x[1] - 0.7 + rounding, [0.0], "sum")
        return Problem((move(end={}, at_end=at_end),))

    solve_once(reaching(0.0)).save(tmp_path / "it.npz")
    assert Extremal.load(tmp_path / "it.npz", reaching(1e-15)).converged


def test_damaged_files_folders_and_missing_files_are_refused(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ExtremalFileError, match="solve its problem again"):
        Extremal.load(path, RELAY)
    with pytest.raises(FileNotFoundError, match="no such file"):
        Extremal.load(path.parent / "none.npz", RELAY)
