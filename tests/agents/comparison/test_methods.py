"""The methods of a comparison, and their rows in its table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.comparison import methods as listed
from agents.comparison.methods import (
    TRAININGS,
    AdaptiveMethod,
    ShippedMethod,
    best_of_seeds,
    front_policy,
    methods,
)
from agents.comparison.study import Setting, Study
from agents.comparison.table import (
    ADAPTIVE,
    FRONT_POLICY,
    PPO_PRIOR,
    SAC_PRIOR,
    attained_rows,
    gait_row,
    policy_row,
)
from agents.evaluate import Protocol
from agents.learner import DoesNotWalkError
from agents.policy_files import LAW_ACTIONS, PRETRAINED, load_policy, read_record
from agents.rollout import draw_starts
from agents.training_config import TrainingConfig
from rimless_gym import BUILDABLE, Task
from rimless_gym.equations import DOUBLE
from rimless_gym.kernel.stepping import MODE
from trajopt.feedback import laws, startup
from trajopt.gaits.fronts import CotFront
from trajopt.gaits.library import shipped
from trajopt.store import Store

EVALUATION = {
    "cot": 0.05,
    "objective": 0.2,
    "speed": 0.56,
    "friction_demand": 0.6,
    "impulse_friction_demand": 0.7,
    "min_normal_force_over_weight": 0.2,
    "walking_share": 1.0,
    "returns": [4.0, 4.2, 5.0],
    "protocol": {"starts": 3, "seed": 1},
}


@pytest.fixture
def setting(tmp_path: Path) -> Setting:
    """A setting whose front is of shipped gaits."""
    made = Setting(Study(), tmp_path)
    gaits = [g for g in shipped() if g.params == BUILDABLE and g.steps == 1]
    made.held_front = CotFront(tuple(g for g in gaits if 0.5 <= g.speed <= 0.6))
    made.least = min(gaits, key=lambda gait: gait.cot)
    return made


@pytest.mark.slow
def test_every_feedback_law_is_a_method_by_its_file(setting: Setting, monkeypatch) -> None:
    (setting.out / "at_rest.py").write_text(
        "from rimless_gym.jit import inner\n"
        "from trajopt.feedback.law import Law\n"
        "from trajopt.feedback.laws import lqr\n\n\n"
        "@inner\n"
        "def nothing(x, mode, data):\n"
        "    return 0.0\n\n\n"
        "def design(solution):\n"
        "    return Law(solution.params, nothing, lqr.design(solution).data)\n"
    )
    monkeypatch.setattr(startup, "startup_for", lambda *args: lambda x, mode: 0 * x[:, 0])
    before = {method.name for method in methods(Study())}
    monkeypatch.setattr(laws, "__path__", [*laws.__path__, str(setting.out)])
    now = {method.name: method for method in methods(Study())}
    assert set(now) - before == {"at_rest"}
    with pytest.warns(UserWarning, match=r"nothing, .* does not hold its gait by itself"):
        result = now["at_rest"].compute(setting)
    [row] = now["at_rest"].rows(setting, result)
    assert (row.title, row.walking_share) == ("at rest about the optimum", 0.0)


def test_the_policy_for_the_front_walks_at_every_speed_of_the_study_and_at_two_between(
    setting: Setting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "front.zip").write_text("another policy")
    monkeypatch.chdir(tmp_path)  # whose file does not replace the shipped one
    study = Study()
    (method,) = front_policy(study)
    assert {study.on_tick(speed) for speed in study.speeds} < set(method.commands)
    assert len(method.commands) == len(study.speeds) + 2
    rows = method.rows(setting, {"evaluations": [EVALUATION] * len(method.commands), "effort": {}})
    assert {row.title for row in rows} == {FRONT_POLICY}
    assert set(study.speeds) < {row.study_speed for row in rows}
    (other,) = front_policy(Study(further=()))
    assert other.name != method.name


def test_the_adaptive_controller_walks_from_fewer_starts_or_is_left_out(
    setting: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    (method,) = (each for each in methods(Study()) if isinstance(each, AdaptiveMethod))

    def refuse(gait: Any, folder: Any) -> Any:
        raise ValueError("no table")

    monkeypatch.setattr(listed.AdaptiveController, "about", refuse)
    assert method.rows(setting, method.compute(setting)) == []
    starts = []

    def evaluated(policy: Any, by: Protocol) -> dict[str, Any]:
        starts.append(by.starts)
        return EVALUATION

    monkeypatch.setattr(listed.AdaptiveController, "about", lambda gait, folder: gait)
    monkeypatch.setattr(setting, "evaluated", evaluated)
    result = method.compute(setting)
    assert "evaluations" not in result  # what is attained from each start, others have from all
    (row,) = method.rows(setting, result)
    assert (row.title, row.cot) == (ADAPTIVE, EVALUATION["cot"])
    assert f"({starts[0]} starts)" in ADAPTIVE


def test_shipped_policies_leave_out_other_machines_and_speeds() -> None:
    for changes in ({"friction": 0.7}, {"gear_loss": 0.0}):
        assert front_policy(Study(changes=changes)) == best_of_seeds(Study(changes=changes)) == ()
    (method,) = front_policy(Study(speed=0.4, further=(0.56,)))
    speeds = load_policy(listed.FRONT_FILE).conditions.control.speeds
    assert speeds is not None
    assert all(speeds[0] <= command <= speeds[1] for command in method.commands)


def test_another_file_of_a_shipped_policy_is_another_result(
    setting: Setting, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    method, *others = best_of_seeds(Study())
    assert [other.title for other in others] == [SAC_PRIOR]
    monkeypatch.setattr(setting, "evaluated", lambda policy: EVALUATION)
    (row,) = method.rows(setting, method.compute(setting))
    assert (row.title, row.study_speed, row.cot) == (PPO_PRIOR, None, EVALUATION["cot"])
    assert row.gap == pytest.approx(setting.gap(0.05, 0.56))
    assert row.return_share == pytest.approx(4.4 / setting.best_return)
    assert row.over_least == pytest.approx(0.05 / setting.least.cot - 1.0)
    copy = tmp_path / method.file.name
    copy.write_bytes(method.file.read_bytes() + b"more")
    assert ShippedMethod(copy, method.title).name != method.name


def test_what_is_attained_is_the_best_of_all_from_each_start_by_kind_of_start() -> None:
    rests = draw_starts(BUILDABLE, 3, 1)[:, MODE] == DOUBLE
    other = EVALUATION | {"returns": [3.0, 4.6, 3.0]}
    rows = attained_rows([EVALUATION, other], BUILDABLE, 5.0)
    shares = np.array([0.8, 0.92, 1.0])
    expected = [shares[some].mean() for some in (rests, ~rests) if some.any()]
    assert [row.return_share for row in rows] == pytest.approx(expected)


def test_what_the_package_has_is_trained_only_where_the_study_asks_for_something_else() -> None:
    trained = {each.name for each in TRAININGS}
    usual = {method.name for method in methods(Study(scratch_timesteps=1, further=()))}
    assert not usual & trained
    for changes in ({"retrain": True}, {"seed": 1}, {"speed": 0.6}, {"changes": {"drag": 0.1}}):
        assert {method.name for method in methods(Study(further=(), **changes))} > trained


def test_what_begins_from_a_policy_that_does_not_walk_is_left_out(
    setting: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(config: TrainingConfig, *arguments: Any, **more: Any) -> Any:
        assert config.startup
        raise DoesNotWalkError("walks from none")

    monkeypatch.setattr(listed, "train", refuse)
    distilled, evolved = TRAININGS[-2:]
    store = Store(setting.out)
    store.save("evolution", {"curve": []})
    store.save("distilled", distilled.compute(setting))
    result = evolved.compute(setting)  # of what it begins from there is no file
    assert result == store.load("distilled") == {"missing": "walks from none"}
    assert distilled.rows(setting, result) == evolved.rows(setting, result) == []


def test_a_shipped_policy_has_what_it_took_and_its_learning_curve(
    setting: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(setting, "evaluated", lambda policy: EVALUATION)
    method = ShippedMethod(PRETRAINED["fine_tuned"], "fine-tuned by CMA-ES", curve=True)
    (row,) = method.rows(setting, result := method.compute(setting))
    assert (row.prior, row.intervals) == (LAW_ACTIONS, result["curve"][-1]["intervals"])
    assert row.minutes == read_record("fine_tuned")["minutes"] >= result["curve"][-1]["minutes"]


def test_rows_have_the_friction_demand_of_stance_and_touchdowns() -> None:
    v = (gait := shipped()[0]).verification
    row = gait_row("optimal", gait, 0.0, 0.5)
    assert row.friction_demand == max(v.max_friction_demand, v.max_impulse_friction_demand)
    assert row.min_normal_force_over_weight == v.min_normal_force_over_weight
    assert policy_row("slipping", EVALUATION, None, None).friction_demand == 0.7
    lifting = EVALUATION | {"impulse_friction_demand": None}
    assert policy_row("lifting", lifting, None, None).friction_demand is None


def test_the_return_of_a_gait_is_the_reward_of_walking_on_it() -> None:
    gait = next(gait for gait in shipped() if gait.params == BUILDABLE and gait.steps == 1)
    v, energy = gait.verification, gait.verification.electrical_positive
    reward = Task().distance_weight * v.distance - energy / gait.params.weight
    row = gait_row("optimal", gait, None, None)
    assert row.objective == pytest.approx(reward / v.time, rel=1e-6)
