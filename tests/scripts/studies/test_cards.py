"""The card of a policy: what it says, and that the shipped cards are those of the shipped files."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from agents.policy_files import PRETRAINED, read_record
from rimless_gym.envs.speed import TASK
from scripts.studies.documents.cards import card, commanded_card

ROW = {
    "policy": "PPO from scratch",
    "walking_share": 0.953,
    "cot": 0.04384,
    "speed": 0.6251,
    "gap": 0.0221,
    "return": 0.2861,
    "friction_demand": 0.714,
    "min_normal_force_over_weight": 0.062,
}
RECORD: dict[str, Any] = {
    "task": {"distance_weight": 0.5},
    "ranges": None,
    "algo": "ppo",
    "timesteps": 1234567,
    "seed": 3,
    "git_revision": "0123456789abcdef",
    "versions": {"rimless-gym": "0.1.0", "torch": "2.13.0"},
}


def told(record: dict[str, Any] = RECORD, row: dict[str, Any] = ROW, init: str = "scratch") -> str:
    return card("mine", record, row, "BUILDABLE", init)


def test_a_card_says_what_the_policy_is_how_it_walks_and_what_made_it() -> None:
    text = told()
    assert text.startswith("# `mine`: PPO from scratch\n\nLearned from nothing: no gait")
    for line in (
        "| task | `RimlessWheel-v0`, reward of the task as it is registered |",
        "| machine | `BUILDABLE` |",
        "| algorithm | ppo |",
        "| steps | 1,234,567 |",
        "| starts that walk | 95% |",
        "| CoT | 0.0438 |",
        "| speed | 0.625 m/s |",
        "| gap to the optimum at this speed | +2.2% |",
        "| return | 0.286 m/s |",
        "| friction demand, least Fy / weight | 0.71, 0.06 |",
        "| made by | revision 0123456789 with rimless-gym 0.1.0, torch 2.13.0 |",
    ):
        assert line in text.splitlines()
    assert "| seed | 3 (one seed;" in text
    assert "`rimless evaluate mine` measures this file" in text


def test_figures_that_a_policy_does_not_have_are_dashes() -> None:
    text = told(row=ROW | {"cot": None, "speed": None, "gap": None})
    for line in ("| CoT | - |", "| speed | - |", "| gap to the optimum at this speed | - |"):
        assert line in text.splitlines()


def test_a_card_names_another_task_ranges_and_that_nothing_was_trained() -> None:
    task, ranges = {"distance_weight": 0.8}, {"pendulum_mass": [1.5, 1.7]}
    text = told(RECORD | {"task": task, "ranges": ranges, "timesteps": 0})
    assert '| task | `RimlessWheel-v0`, reward of {"distance_weight": 0.8} |' in text
    assert '| machine | `BUILDABLE`, ranges {"pendulum_mass": [1.5, 1.7]} |' in text
    assert "| steps | none: only cloned |" in text


@pytest.mark.parametrize(
    ("init", "origin"),
    [
        ("imitation", "A clone of the LQR about the environment's own optimum."),
        ("imitation of evolution policy 12ab", "A network cloned from the evolved policy: no gait"),
        ("ppo policy 12ab", "It began as: ppo policy 12ab."),
    ],
)
def test_a_card_says_what_the_training_began_from(init: str, origin: str) -> None:
    assert told(init=init).splitlines()[2].startswith(origin)


@pytest.mark.parametrize("name", sorted(PRETRAINED))
def test_the_card_of_a_shipped_policy_is_that_of_its_file(name: str) -> None:
    shipped = PRETRAINED[name].with_suffix(".md").read_text().splitlines()
    record = read_record(PRETRAINED[name])
    fields = ["task", "machine", "algorithm", "steps", "seed", "made by"]
    if record.get("speeds"):
        text = commanded_card(name, record, [ROW | {"at": 0.5}], "BUILDABLE", "scratch", "")
        fields.append("commands")
    else:
        text = card(name, record, ROW, "BUILDABLE", "scratch")
    from_file = text.splitlines()
    for field in fields:
        (line,) = [line for line in from_file if line.startswith(f"| {field} |")]
        assert line in shipped


def test_a_card_names_disturbances_and_how_the_policy_is_made_again() -> None:
    disturbances = {"actuator_delay": 2}
    text = card("mine", RECORD | {"disturbances": disturbances}, ROW, "BUILDABLE", "x", "Ask;")
    assert '| machine | `BUILDABLE`, disturbances {"actuator_delay": 2} |' in text
    assert "30 s. Ask; `rimless evaluate mine` measures" in text


def test_a_card_has_a_line_for_each_command_of_a_policy_that_walks_at_commanded_speeds() -> None:
    record = RECORD | {"speeds": [0.5, 0.6], "control_period": 0.01}
    fallen = dict.fromkeys(ROW) | {"policy": "x", "walking_share": 0.0}
    rows = [ROW | {"at": 0.62}, fallen | {"at": 0.5}]
    lines = commanded_card("mine", record, rows, "BUILDABLE", "imitation with {}", "Ask;").split(
        "\n"
    )
    assert lines[0] == "# `mine`: PPO from scratch"
    assert lines[2].startswith("A clone of LQRs about")
    for line in (
        '| task | `RimlessWheelSpeed-v0`, reward of {"distance_weight": 0.5} |',
        "| commands | 0.5 to 0.6 m/s, a decision every 10 ms |",
        "| 0.62 m/s | 95% | 0.0438 | 0.625 m/s | +2.2% | 0.71 | 0.06 |",
        "| 0.5 m/s | 0% | - | - | - | - | - |",
    ):
        assert line in lines
    assert lines[-3:-1] == [
        "the optimum at the walked speed. Ask;",
        "`rimless evaluate mine --gap` measures this file.",
    ]


def test_the_prices_of_the_environment_with_commands_are_its_usual_task() -> None:
    task = dataclasses.asdict(TASK)
    record = RECORD | {"task": task, "speeds": [0.5, 0.6], "control_period": 0.01}
    text = commanded_card("mine", record, [ROW | {"at": 0.5}], "BUILDABLE", "scratch", "Ask;")
    assert "| task | `RimlessWheelSpeed-v0`, reward of the task as it is registered |" in text
