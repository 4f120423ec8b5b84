"""The card of a policy: what it says, and that the shipped cards are those of the shipped files."""

from __future__ import annotations

from typing import Any

import pytest

from agents.policy_files import PRETRAINED, read_record
from scripts.documents.cards import card

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
    "task": {"value_of_distance": 0.5},
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
    assert "`python scripts/evaluate.py mine` measures this file" in text


def test_figures_that_a_policy_does_not_have_are_dashes() -> None:
    text = told(row=ROW | {"cot": None, "speed": None, "gap": None})
    for line in ("| CoT | - |", "| speed | - |", "| gap to the optimum at this speed | - |"):
        assert line in text.splitlines()


def test_a_card_names_another_task_ranges_and_that_nothing_was_trained() -> None:
    task, ranges = {"value_of_distance": 0.8}, {"pendulum_mass": [1.5, 1.7]}
    text = told(RECORD | {"task": task, "ranges": ranges, "timesteps": 0})
    assert '| task | `RimlessWheel-v0`, reward of {"value_of_distance": 0.8} |' in text
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
    from_file = card(name, read_record(PRETRAINED[name]), ROW, "BUILDABLE", "scratch").splitlines()
    for field in ("task", "machine", "algorithm", "steps", "seed", "made by"):
        (line,) = [line for line in from_file if line.startswith(f"| {field} |")]
        assert line in shipped


def test_a_card_names_disturbances_and_how_the_policy_is_made_again() -> None:
    disturbances = {"actuator_delay": 2}
    text = card("mine", RECORD | {"disturbances": disturbances}, ROW, "BUILDABLE", "x", "Ask;")
    assert '| machine | `BUILDABLE`, disturbances {"actuator_delay": 2} |' in text
    assert "30 s. Ask; `python scripts/evaluate.py mine` measures" in text
