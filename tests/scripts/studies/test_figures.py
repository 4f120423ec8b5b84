"""The documents' numbers are those in numbers.json, and numbers.json holds what the code gives."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from rimless_gym.presets import PRESETS
from scripts.studies.documents import accuracy, errata
from scripts.studies.documents.accuracy import CASES
from scripts.studies.documents.figures import DOCUMENTS, filled, tables

ROOT = Path(__file__).parents[3]
FIGURES = ROOT / "docs" / "figures"
RECORDED: dict[str, Any] = json.loads((FIGURES / "numbers.json").read_text())
PAGES = {name: (ROOT / "docs" / name).read_text() for name in DOCUMENTS}


def test_the_printed_impact_does_what_is_recorded() -> None:
    measured, recorded = errata.printed_impact(), RECORDED["printed_impact"]
    for name, shares in measured["random"].items():
        assert shares == pytest.approx(recorded["random"][name], rel=1e-6, abs=1e-7)
    for ratios, known in zip(measured["typical"], recorded["typical"], strict=True):
        assert ratios == pytest.approx(known, rel=1e-6, abs=1e-7)


def test_properties_of_the_presets_are_as_recorded() -> None:
    for name, params in PRESETS.items():
        assert params.motor_pole == pytest.approx(RECORDED["motor_pole"][name])
        assert errata.kappa_range(params) == pytest.approx(RECORDED["kappa"][name])
        assert errata.reach_and_hub(params) == pytest.approx(RECORDED["reach_and_hub"][name])


@pytest.mark.slow
def test_the_integrator_converges_at_the_recorded_order() -> None:
    for name, order in errata.orders().items():
        assert order == pytest.approx(RECORDED["order"][name], abs=0.1)


def test_the_recorded_accuracy_meets_its_targets() -> None:
    for name, params in PRESETS.items():
        rounding = 3e-9 if params.hub_friction > 0 else 1e-9  # friction turns round so quickly
        for case in CASES:
            recorded = RECORDED["accuracy"][name][case]
            assert recorded["disagreements"] == 0, (name, case)
            assert recorded["state"] <= max(rounding, recorded["nudged"]), (name, case)
            assert case == "graze" or recorded["state"] <= rounding, (name, case)


def test_the_documents_hold_the_tables_of_the_recorded_numbers() -> None:
    pages = "\n".join(PAGES.values())
    for name, table in tables(RECORDED).items():
        assert table in pages, f"table {name}: run scripts.studies figures --keep-numbers"


def test_tables_are_replaced_where_their_headings_are() -> None:
    page = PAGES["physics.md"]
    walks = sum(of["walking"]["motions"] for of in RECORDED["accuracy"].values())
    old = page.replace(f"| walking | {walks} |", f"| walking | {walks + 1} |")
    old = old.replace("| rocking", "| rolling")
    assert old != page
    assert filled(old, RECORDED) == page


def test_the_text_of_the_model_quotes_the_recorded_numbers() -> None:
    text = " ".join(PAGES["physics.md"].split())
    for low, high in RECORDED["kappa"].values():
        assert f"{low:.2f} to {high:.2f}" in text
    for name, order in RECORDED["order"].items():
        assert f"{order:.1f} for `{name}`" in text
    energies = [case["energy"] for of in RECORDED["accuracy"].values() for case in of.values()]
    assert max(energies) <= 1e-7
    assert "within 1e-7 J" in text


def test_every_figure_is_shown_and_its_file_is_small() -> None:
    shown = {name for page in PAGES.values() for name in re.findall(r"figures/(\w+\.png)", page)}
    assert shown == {path.name for path in FIGURES.glob("*.png")}
    assert all((FIGURES / name).stat().st_size < 150_000 for name in shown)


@pytest.mark.slow
@pytest.mark.parametrize("name", PRESETS)
def test_the_kernel_is_as_near_the_reference_as_recorded(name: str) -> None:
    for case in CASES:
        measured = accuracy.measured(name, case, 10 if case == "graze" else 2)
        recorded = RECORDED["accuracy"][name][case]
        assert measured.disagreements == 0
        for key in ("state", "energy", "residual"):
            assert getattr(measured, key) <= 3 * recorded[key] + 1e-11, (case, key)
