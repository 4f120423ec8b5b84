"""The tables of returns, and that the reward thresholds are what they are said to be."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

from agents.baselines import BASELINES
from agents.conditions import Conditions
from agents.policy_files import PRETRAINED, read_record
from rimless_gym import BUILDABLE, RimlessWheelEnv, RimlessWheelSpeedEnv
from rimless_gym.envs.speed import SPEEDS
from scripts.studies.episode_returns import bounds, command, page
from scripts.studies.episode_returns.measure import COMMANDED, FRONT, WHEEL, measured
from trajopt.feedback import laws
from trajopt.gaits.shipped import shipped

DOCS = Path(__file__).parents[3] / "docs"
RECORDED: dict[str, Any] = json.loads((DOCS / "returns.json").read_text())
MEANS = {env: {row["name"]: row["mean"] for row in RECORDED[env]} for env in page.ENVIRONMENTS}


def test_the_page_has_the_tables_of_what_was_measured() -> None:
    text = (DOCS / "environment.md").read_text()
    for env, table in page.sections(RECORDED).items():
        assert f"<!-- returns: {env} -->\n{table}<!-- end of {env} -->" in text


def test_everybody_is_in_the_tables() -> None:
    commanded = {name for name, path in PRETRAINED.items() if read_record(path).get("speeds")}
    assert set(MEANS[WHEEL]) == {*BASELINES, *laws.names(), *PRETRAINED, FRONT} - commanded
    assert set(MEANS[COMMANDED]) == {*BASELINES, *commanded, FRONT}
    assert FRONT not in PRETRAINED


@pytest.mark.parametrize("env", page.ENVIRONMENTS)
def test_a_threshold_is_two_thirds_of_what_the_front_earns(env: str) -> None:
    threshold = gym.spec(env).reward_threshold
    assert threshold is not None
    assert threshold == pytest.approx(2 / 3 * MEANS[env][FRONT], rel=0.03)
    for name in BASELINES:
        assert MEANS[env][name] < 0.0
    assert gym.make_vec(env, num_envs=1).spec.reward_threshold == threshold


def test_the_laws_that_walk_from_everywhere_reach_the_threshold_and_who_leans_does_not() -> None:
    threshold = gym.spec(WHEEL).reward_threshold
    assert threshold is not None
    for name in ("lqr", "sliding_mode", "imitation", "fine_tuned"):
        assert MEANS[WHEEL][name] > threshold
    assert MEANS[WHEEL]["ppo"] < threshold


def test_the_documentation_pages_quote_the_table() -> None:
    text = " ".join((RimlessWheelEnv.__doc__ or "").split())
    means = MEANS[WHEEL]
    for name, quoted in (
        ("idle", f"resting {means['idle']:.1f}"),
        ("random", f"random voltages {means['random']:.0f}"),
        ("lqr", f"an LQR {means['lqr']:.1f}"),
        (FRONT, f"the front's best gait {means[FRONT]:.1f}"),
    ):
        assert quoted in text, name
    assert f"`reward_threshold` is {gym.spec(WHEEL).reward_threshold:g}" in text
    commanded = " ".join((RimlessWheelSpeedEnv.__doc__ or "").split())
    assert f"`reward_threshold` is {gym.spec(COMMANDED).reward_threshold:g}" in commanded
    assert f"the front, {MEANS[COMMANDED][FRONT]:.0f}" in commanded


@pytest.mark.slow
def test_resting_earns_what_was_recorded() -> None:
    commanded = Conditions.of(BUILDABLE, None, None, SPEEDS)
    for env, conditions in ((WHEEL, Conditions(BUILDABLE)), (COMMANDED, commanded)):
        (row,) = [row for row in RECORDED[env] if row["name"] == "idle"]
        found = measured(BASELINES["idle"](0), conditions, RECORDED["episodes"])
        assert found["mean"] == pytest.approx(row["mean"], abs=1e-6)


def test_a_gait_earns_its_speed_times_the_price_less_its_cost() -> None:
    gait = shipped()[0]
    assert bounds.earned(gait) == pytest.approx(20 * gait.speed * (0.5 - gait.cot))
    assert bounds.earned_at(0.5) == pytest.approx(20 * 0.5 * (5 - 0.06), rel=0.01)


def test_one_walker_is_measured_again_and_the_other_lines_stay(tmp_path: Path) -> None:
    page_copy = tmp_path / "environment.md"
    page_copy.write_text((DOCS / "environment.md").read_text())
    few = {"episodes": 2, WHEEL: [], COMMANDED: [{"name": FRONT, "mean": 9.0}]}
    (tmp_path / "returns.json").write_text(json.dumps({**RECORDED, **few}))
    assert command.main(["idle", "--docs", str(page_copy), "--out", str(tmp_path / "out")]) == 0
    found = json.loads((tmp_path / "returns.json").read_text())
    assert [row["name"] for row in found[WHEEL]] == ["idle"]
    assert [row["name"] for row in found[COMMANDED]] == [FRONT, "idle"]
    assert found["git_revision"] == RECORDED["git_revision"]
    assert "git_revision" in found[WHEEL][0]
    assert (
        "| the front, walked at the commanded speed for all 20 s | 9.00 |" in page_copy.read_text()
    )


@pytest.mark.parametrize("arguments", [["nobody", "--docs", "page.md"], ["idle"]])
def test_names_without_a_line_and_names_without_a_page_are_refused(arguments: list[str]) -> None:
    with pytest.raises(SystemExit):
        command.main(arguments)


def test_a_policy_at_commanded_speeds_has_a_line_that_says_which() -> None:
    row = {"name": "mine", "mean": 50.0, "spread": 1.0, "early": 0.0, "speeds": [0.5, 0.6]}
    table = page.sections({**RECORDED, COMMANDED: [row | {"period": 0.01}]})[COMMANDED]
    assert "| policy `mine`, commanded 0.5 to 0.6 m/s, a decision every 10 ms | 50.00 |" in table
