"""A solved gait: its trajectory, report and plot; its file, and which files are refused."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rimless_gym.symbolic import HybridModel
from trajopt import Solution
from trajopt.gaits.library import index
from trajopt.gaits.solution import FORMAT, GaitFileError
from trajopt.gaits.verify import verify
from trajopt.store import digest

# -- trajectory -----------------------------------------------------------------------------------


def test_touchdowns_link_the_phases_and_the_last_one_closes_the_ring(gait: Solution) -> None:
    model = HybridModel(gait.params)
    for time in gait.phase_times[1:]:
        before, after = gait.state(time, side="left"), gait.state(time)
        assert before[0] == pytest.approx(gait.params.constants.b, abs=1e-9)
        assert np.allclose(np.asarray(model.touchdown(before)).ravel(), after, atol=1e-9)
        assert before[2] > 0
        assert after[2] > 0


def test_limits_hold_between_the_nodes(gait: Solution) -> None:
    t = np.linspace(0, gait.duration, 5_000, endpoint=False)
    x, u, p = gait.state(t).T, gait.control(t), gait.params
    force = HybridModel(p).functions["ground_reaction"].map(len(t))
    fx, fy = np.asarray(force(x, u[None]))
    assert x[0].min() >= p.constants.a - 1e-7
    assert x[0].max() <= p.constants.b + 1e-7
    assert np.abs(u).max() <= p.voltage_limit * (1 + 1e-9)
    assert fy.min() >= 0.05 * p.weight * (1 - 1e-3)
    assert (np.abs(fx) / fy).max() <= p.friction * (1 + 1e-3)


def test_the_state_is_periodic_but_for_the_turns_of_theta(gait: Solution) -> None:
    t = np.array([0.1, 0.7, 1.3])
    assert np.abs(t[:, None] - gait.breakpoints).min() > 1e-6  # where the voltage may jump
    shift = np.array([0, 2 * math.pi * gait.theta_turns, 0, 0])
    assert np.allclose(gait.state(t + gait.duration), gait.state(t) + shift)
    assert np.allclose(gait.state(t - 2 * gait.duration), gait.state(t) - 2 * shift)
    assert np.allclose(gait.control(t + gait.duration), gait.control(t))
    assert gait.state(0.3).shape == (4,)
    assert isinstance(gait.control(0.3), float)


def test_the_report_shows_a_failed_verification(one_step: Solution) -> None:
    phases = [dataclasses.replace(p, controls=p.controls + 0.1) for p in one_step.phases]
    spoilt = verify(one_step.params, phases, one_step.theta_turns)
    assert not spoilt.passed
    assert "FAILED" in dataclasses.replace(one_step, verification=spoilt).report()


# -- file -----------------------------------------------------------------------------------------


@pytest.fixture
def path(tmp_path: Path) -> Path:
    index()[0].load().save(tmp_path / "gait.npz")
    return tmp_path / "gait.npz"


def rewrite(path: Path, header: Callable[[dict], Any] = lambda h: h, **arrays: Any) -> None:
    """Change a file's header or arrays (None: leave out), with a digest that fits."""
    with np.load(path) as data:
        content = {name: data[name] for name in data.files} | arrays
    content = {name: array for name, array in content.items() if array is not None}
    changed = header(json.loads(str(content.pop("header"))))
    del content["digest"]
    content["header"] = np.array(changed if isinstance(changed, str) else json.dumps(changed))
    np.savez_compressed(path, **content, digest=np.array(digest(content)))


def refused(path: Path, match: str) -> None:
    with pytest.raises(GaitFileError, match=rf"(?s){path.name}: .*{match}.*again"):
        Solution.load(path)


def test_a_saved_gait_loads_exactly(gait: Solution, tmp_path: Path) -> None:
    gait.save(tmp_path / "gait.npz")
    loaded = Solution.load(tmp_path / "gait.npz")
    t = np.linspace(-1, 3, 100)
    assert np.array_equal(loaded.state(t), gait.state(t))
    assert np.array_equal(loaded.control(t), gait.control(t))
    assert loaded.params == gait.params
    assert loaded.to_dict() == gait.to_dict()
    assert loaded.report() == gait.report()


def test_missing_and_foreign_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        Solution.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("no archive")
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    with (tmp_path / "array.npz").open("wb") as file:
        np.save(file, np.zeros(3))
    for name in ("text", "other", "array"):
        refused(tmp_path / f"{name}.npz", "not a file of format 'rimless-gym gait")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda h: h | {"format": "rimless-gym gait 1"}, f"gait 1.*{FORMAT}"),
        (lambda h: {key: value for key, value in h.items() if key != "verification"}, "no valid"),
        (lambda h: h | {"verification": None}, "no valid gait"),
        (lambda h: h | {"params": {"wheel_mass": -1}}, "no valid gait"),
        (lambda h: "[]", "not a file of format 'rimless-gym gait"),
        (lambda h: "not JSON", "not a file of format 'rimless-gym gait"),
    ],
)
def test_headers_that_are_wrong_are_refused_even_if_signed(
    path: Path, change: Callable[[dict], Any], match: str
) -> None:
    rewrite(path, change)
    refused(path, match)


@pytest.mark.parametrize("name", ["edges", "nodes", "states", "control_nodes", "controls"])
def test_arrays_that_do_not_fit_are_refused_even_if_signed(path: Path, name: str) -> None:
    with np.load(path) as data:
        cut = data[f"phase0_{name}"][:-1]
    rewrite(path, **{f"phase0_{name}": cut})
    refused(path, "of shape")


def test_damage_anywhere_is_refused_or_harmless(path: Path) -> None:
    whole, gait = path.read_bytes(), Solution.load(path).to_dict()
    rng = np.random.default_rng(0)
    refusals = 0
    for position in rng.integers(0, len(whole), 60):
        content = bytearray(whole)
        content[position] ^= 1 << int(rng.integers(8))
        path.write_bytes(content)
        try:
            assert Solution.load(path).to_dict() == gait
        except GaitFileError:
            refusals += 1
    assert refusals > 40
    for length in rng.integers(0, len(whole), 5):
        path.write_bytes(whole[:length])
        refused(path, "not a file of format 'rimless-gym gait")
