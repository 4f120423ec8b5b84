from __future__ import annotations

import math
from pathlib import Path

import pytest

from rimless_gym import BUILDABLE
from rimless_gym.commands.learning_trials import page, trials
from rimless_gym.commands.learning_trials.command import main
from rimless_gym.commands.learning_trials.trials import Duration, Family, Steady

PAGE = Path(__file__).resolve().parents[3] / "docs" / "learning.md"


@pytest.fixture(autouse=True)
def brief(monkeypatch):
    monkeypatch.setattr(trials, "STEADY", [0.0, 0.6])
    monkeypatch.setattr(trials, "STEADY_STARTS", 12)
    monkeypatch.setattr(trials, "LONG", Duration(1000, 500))
    monkeypatch.setattr(trials, "RANDOM", 200)
    monkeypatch.setattr(trials, "SHORT", Duration(400, 200))


def test_without_a_voltage_nothing_moves_and_only_idle_power_is_paid():
    still, rolling = trials.steady(BUILDABLE)
    assert (still.steps, still.falls) == (0.0, 0.0)
    assert math.isnan(still.cot)
    assert still.reward == pytest.approx(-BUILDABLE.idle_power / BUILDABLE.weight, abs=0.01)
    assert rolling.steps > 0.0
    assert rolling.cot > 0.5  # the true price: walking like this does not pay
    assert rolling.reward < still.reward


def test_random_policies_find_the_family_that_leans():
    found = trials.random(BUILDABLE)
    assert found[0].turns == 0
    assert 0 < found[0].policies < 200
    assert found[0].cot > 0.1


def test_the_page_is_filled_the_same_way_twice(tmp_path):
    text = tmp_path / "learning.md"
    text.write_text(PAGE.read_text())
    sections = {
        "steady": page.steady_table([Steady(0.6, 0.1, 0.5, 1.01, 0.77, -0.57)]),
        "random": page.random_table([Family(-1, 3, 0, 0.51)]),
    }
    page.refresh(text, sections)
    once = text.read_text()
    assert "| -1 | 3 | 0 | 0.51 |" in once
    assert "| +0.6 | 10 % | 50 % | 1.01 | 0.77 | -0.57 |" in once
    page.refresh(text, sections)
    assert text.read_text() == once


def test_a_page_without_a_place_for_the_tables_is_refused(tmp_path, capsys):
    other = tmp_path / "other.md"
    other.write_text("# Another page\n")
    with pytest.raises(SystemExit):
        main(["--docs", str(other)])
    assert "<!-- learning: steady -->" in capsys.readouterr().err
    assert other.read_text() == "# Another page\n"
