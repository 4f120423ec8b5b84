"""The documents' numbers are those of numbers.json, and those are what the code gives."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
FIGURES = ROOT / "docs" / "figures"
RECORDED: dict[str, Any] = json.loads((FIGURES / "numbers.json").read_text())
PAGES = {name: (ROOT / "docs" / name).read_text() for name in ("physics.md", "thesis-errata.md")}


def script() -> ModuleType:
    name = "scripts_figures"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, ROOT / "scripts" / "figures.py")
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def assert_alike(ours: Any, theirs: Any, where: str) -> None:
    if isinstance(ours, dict):
        assert ours.keys() == theirs.keys(), where
        for key in ours:
            assert_alike(ours[key], theirs[key], f"{where}.{key}")
    elif isinstance(ours, list):
        assert len(ours) == len(theirs), where
        for i, (mine, other) in enumerate(zip(ours, theirs, strict=True)):
            assert_alike(mine, other, f"{where}[{i}]")
    elif isinstance(ours, float):
        assert ours == pytest.approx(theirs, rel=1e-6, abs=1e-7), where
    else:
        assert ours == theirs, where


@pytest.mark.parametrize(
    "part",
    ["coming_to_rest", "printed_impact", "new_foot_momentum", "generalised_force", "rotor"],
)
def test_recorded_numbers_are_what_the_code_gives(part: str) -> None:
    assert_alike(getattr(script(), part)(), RECORDED[part], part)


def test_properties_of_the_presets_are_as_recorded() -> None:
    figures = script()
    for name, params in figures.PRESETS.items():
        assert params.motor_pole == pytest.approx(RECORDED["motor_pole"][name])
        assert figures.kappa_range(params) == pytest.approx(RECORDED["kappa"][name])
        assert figures.reach_and_hub(params) == pytest.approx(RECORDED["reach_and_hub"][name])


def test_the_integrator_converges_at_the_recorded_order() -> None:
    for name, measured in script().convergence(count=20).items():
        assert measured["order"] == pytest.approx(RECORDED["convergence"][name]["order"], abs=0.1)


def test_the_documents_hold_the_tables_of_the_recorded_numbers() -> None:
    pages = "\n".join(PAGES.values())
    for name, table in script().tables(RECORDED).items():
        assert table in pages, f"table {name}: paste what scripts/figures.py prints"


def test_the_text_quotes_the_recorded_numbers() -> None:
    text = " ".join(PAGES["physics.md"].split())
    for low, high in RECORDED["kappa"].values():
        assert f"{low:.2f} to {high:.2f}" in text
    for result in RECORDED["convergence"].values():
        assert f"{result['order']:.1f} for `" in text
    for name in ("THESIS_PHYSICAL", "THESIS_NOMINAL", "PROTOTYPE"):
        assert f"{RECORDED['missed_dips'][name]['unlike']} (`{name}`)" in text
    deepest = max(result["deepest"] for result in RECORDED["missed_dips"].values())
    assert f"{1e6 * deepest:.0f} µm" in text
    for reach, hub in RECORDED["reach_and_hub"].values():
        assert f"{reach:.2f} m against {hub:.2f} m" in text


def test_every_figure_is_shown_and_small() -> None:
    shown = {name for page in PAGES.values() for name in re.findall(r"figures/(\w+\.png)", page)}
    assert shown == {path.name for path in FIGURES.glob("*.png")}
    assert all((FIGURES / name).stat().st_size < 150_000 for name in shown)


@pytest.mark.slow
def test_the_kernel_is_as_near_the_reference_as_recorded() -> None:
    figures = script()
    for name in figures.PRESETS:
        for case, motion in figures.CASES.items():
            measured, rng = figures.Accuracy(), np.random.default_rng(11)
            for _ in range(10 if "graze" in case else 2):
                measured.add(motion(name, rng))
            recorded = RECORDED["accuracy"][name][case]
            for key in ("state", "height", "energy", "residual"):
                assert getattr(measured, key) <= 3 * recorded[key] + 1e-11, (name, case, key)
