"""Solutions in files: the same when loaded, refused if edited, damaged or of another problem."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from trajopt.files import HEADER, write_arrays
from trajopt.ocp.extremal import Extremal, ExtremalFileError, load_phases
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Linkage, Phase, Problem
from trajopt.ocp.solve import solve


def relay(weight: float = 1.0, fastest: float = 5.0) -> Problem:
    """A trolley hands a load of mass m to another one halfway; m may be chosen."""
    leg = Phase(
        "first",
        states=("x", "v"),
        controls=("f",),
        flow=lambda x, u, p: [x[1], u[0] / p[0]],
        cost=lambda x, u, p: weight * u[0] ** 2 + 1.0 / p[0],
        bounds={"v": (0.0, fastest)},
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
    assert loaded.to_dict() == extremal.to_dict()
    assert loaded.mesh == extremal.mesh
    for name in ("attempts", "violations", "audit", "resimulation", "provenance"):
        assert getattr(loaded, name) == getattr(extremal, name)
    for one, other in zip(loaded.certificate.costates, extremal.certificate.costates, strict=True):
        assert np.array_equal(one, other)
    assert np.array_equal(loaded.state(0.7), extremal.state(0.7))


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
    assert again.cost == pytest.approx(extremal.cost, rel=1e-6)


def test_figures_are_strict_json(extremal: Extremal) -> None:
    figures = json.loads(json.dumps(extremal.to_dict(), allow_nan=False))
    assert figures["cost"] == extremal.cost
    assert figures["converged"] is True
    assert figures["parameters"]["m"] == extremal.parameters[0]


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        (relay(weight=1.1), "flow or the running cost"),
        (relay(fastest=0.6), "bound of v"),
        (Problem((RELAY.phases[0],), parameters={"m": 1.0}), "other names"),
    ],
)
def test_a_solution_of_another_problem_is_refused(path: Path, other: Problem, reason: str) -> None:
    with pytest.raises(ExtremalFileError, match=reason):
        Extremal.load(path, other)


def rewritten(path: Path, change: dict[str, Any], **closed: Any) -> None:
    with np.load(path) as data:
        arrays = {**data} | change
    np.savez_compressed(path, **arrays, **closed)


def test_an_edited_file_is_refused(path: Path) -> None:
    rewritten(path, {"parameters": np.array([1.0])})
    with pytest.raises(ExtremalFileError, match="edited or damaged"):
        Extremal.load(path, RELAY)


def test_an_edited_header_is_refused(path: Path) -> None:
    with np.load(path) as data:
        header = str(data[HEADER]).replace('"mesh_error": ', '"mesh_error": 1')
    rewritten(path, {HEADER: np.array(header)})
    with pytest.raises(ExtremalFileError, match="edited or damaged"):
        load_phases(path)


def test_a_flipped_byte_is_noticed_or_touches_nothing(extremal: Extremal, path: Path) -> None:
    content = path.read_bytes()
    refused = 0
    for at in np.linspace(0, len(content) - 1, 60, dtype=int):
        damaged = bytearray(content)
        damaged[at] ^= 0xFF
        path.write_bytes(damaged)
        try:
            assert Extremal.load(path, RELAY).report() == extremal.report()
        except ExtremalFileError:
            refused += 1
    assert refused > 40


def test_damaged_files_folders_and_missing_files_are_refused(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ExtremalFileError, match="solve its problem again"):
        Extremal.load(path, RELAY)
    with pytest.raises(FileNotFoundError, match="no such file"):
        Extremal.load(path.parent / "none.npz", RELAY)


def test_pickles_are_not_read(tmp_path: Path) -> None:
    path = tmp_path / "pickle.npz"
    np.savez(path, header=np.array([{"format": "any"}], dtype=object))
    with pytest.raises(ExtremalFileError, match="damaged, or not a file"):
        load_phases(path)


def test_files_of_another_format_name_both(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    write_arrays(path, "stamps 3", {}, {"a": np.ones(2)})
    with pytest.raises(ExtremalFileError, match="stamps 3"):
        load_phases(path)
