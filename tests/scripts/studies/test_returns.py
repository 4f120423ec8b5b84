"""The tables of returns, and that the reward thresholds are what the pages quote."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import gymnasium as gym
import pytest

from agents.conditions import Conditions
from agents.policy_files import BASELINES, PRETRAINED, read_record
from rimless_gym import BUILDABLE, RimlessWheelEnv, RimlessWheelSpeedEnv, Task
from rimless_gym.envs.speed import SPEEDS
from scripts.studies import returns
from scripts.studies.returns import COMMANDED, ENVIRONMENTS, FRONT, WHEEL
from trajopt.feedback import laws

DOCS = Path(__file__).parents[3] / "docs"
RECORDED: dict[str, Any] = json.loads((DOCS / "returns.json").read_text())
MEANS = {env: {row["name"]: row["mean"] for row in RECORDED[env]} for env in ENVIRONMENTS}


def test_the_page_has_the_tables_of_what_was_measured() -> None:
    text = (DOCS / "environment.md").read_text()
    for env, table in returns.sections(RECORDED).items():
        assert f"<!-- returns: {env} -->\n{table}<!-- end of {env} -->" in text


def test_all_policies_and_laws_are_in_the_tables() -> None:
    commanded = {name for name, path in PRETRAINED.items() if read_record(path).get("speeds")}
    assert set(MEANS[WHEEL]) == {*BASELINES, *laws.names(), *PRETRAINED, FRONT} - commanded
    assert set(MEANS[COMMANDED]) == {*BASELINES, *commanded, FRONT}


def test_a_threshold_is_the_return_of_a_walk_at_a_quarter_more_cost_after_a_start_up() -> None:
    speed = next(row["speed"] for row in RECORDED[WHEEL] if row["name"] == FRONT)
    best = MEANS[WHEEL][FRONT]
    quarter_more = best - 0.25 * (20 * speed * Task().distance_weight - best)
    lqr = next(row for row in RECORDED[WHEEL] if row["name"] == "lqr")
    own = next(row for row in RECORDED[COMMANDED] if row["name"] == "front")
    narrow, wide = (returns.commands(tuple(each), 100) for each in (own["speeds"], SPEEDS))
    expected = {
        WHEEL: quarter_more * lqr["rest"] / best,
        COMMANDED: returns.front_return(wide, 1.25).mean()
        * own["rest"]
        / returns.front_return(narrow).mean(),
    }
    for env in ENVIRONMENTS:
        # a registered threshold stays when the policy `front` becomes a little better
        assert gym.spec(env).reward_threshold == pytest.approx(expected[env], rel=0.02)
        assert all(MEANS[env][name] < 0.0 for name in BASELINES)


def test_laws_their_clone_and_its_fine_tuning_reach_the_threshold_but_no_expensive_walk() -> None:
    threshold = gym.spec(WHEEL).reward_threshold
    assert threshold is not None
    means = MEANS[WHEEL]
    assert all(means[n] > threshold for n in ("sliding_mode", "imitation", "fine_tuned"))
    assert all(means[n] < 0.9 * threshold for n in ("robust", "evolution", "receding_horizon"))


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
    commanded = " ".join((RimlessWheelSpeedEnv.__doc__ or "").split())
    assert f"The front would return {MEANS[COMMANDED][FRONT]:.0f} m" in commanded
    for env, page in ((WHEEL, text), (COMMANDED, commanded)):
        assert f"`reward_threshold` is {gym.spec(env).reward_threshold:g}" in page


def test_the_return_of_a_walk_is_its_speed_times_the_weight_less_its_cost() -> None:
    assert returns.front_return(0.5) == pytest.approx(20 * 0.5 * (5 - 0.06), rel=0.01)


@pytest.mark.slow
def test_a_study_that_was_interrupted_continues(tmp_path: Path) -> None:
    first = returns.all_returns(tmp_path, 2, ["idle"])
    rest = returns.all_returns(tmp_path, 2, ["idle", "random"])
    assert rest[WHEEL][0] == first[WHEEL][0]
    assert [row["name"] for row in rest[COMMANDED]] == ["idle", "random"]
    idle = returns.measured(BASELINES["idle"](0), Conditions(BUILDABLE), RECORDED["episodes"])
    assert idle["mean"] == pytest.approx(MEANS[WHEEL]["idle"], abs=1e-6)
