"""The rows of the study."""

from __future__ import annotations

import dataclasses
import json
import pickle
from typing import Any

import pytest

from agents import learners
from agents.imitation import Cloning
from agents.training import SCRATCH
from scripts.studies.learning import page
from scripts.studies.learning.cells import Cell
from scripts.studies.learning.rows import DEMONSTRATIONS, PRICE, ROWS
from scripts.studies.learning.successors import Successor
from scripts.studies.learning.trials import Trained


def test_every_row_has_a_name_of_its_own_and_plain_settings_and_goes_to_other_processes() -> None:
    assert len({row.name for row in ROWS}) == len(ROWS)
    for row in ROWS:
        for trial in (row.trial, row.trial.brief()):
            assert json.loads(json.dumps(trial.settings)) == trial.settings
        assert pickle.loads(pickle.dumps({Cell(row, 0): 1})) == {Cell(row, 0): 1}


def test_a_row_that_another_needs_is_trained_before_it() -> None:
    for place, row in enumerate(ROWS):
        if isinstance(row.trial, Successor):
            assert row.trial.before in ROWS[:place]


def test_every_row_has_a_table_in_the_page() -> None:
    assert {row.table for row in ROWS} == set(page.SECTIONS)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("price_true", {"first_price": 0.5, "fall_penalty": 2.0, "slip_penalty": 2.0}),
        ("price_stays", {"least_price": 5.0}),
        ("price_any_speed", {"least_price": 5.0, "paid_speed": 100.0}),
        ("price_drops", {"first_price": 0.5, "fall_penalty": 2.0, "slip_penalty": 2.0}),
    ],
)
def test_a_row_about_the_price_differs_from_ppo_only_in_what_is_paid(
    name: str, changes: dict[str, Any]
) -> None:
    (row,) = (row for row in ROWS if (row.table, row.name) == (PRICE, name))
    assert isinstance(row.trial, Trained)
    ppo = learners.learner("ppo")
    usual: Any = ppo.settings(SCRATCH)
    found: Any = ppo.settings(row.trial.init, row.trial.hyperparameters)
    assert found.pacing == dataclasses.replace(usual.pacing, **changes)
    assert found.written | {"callback": usual.written["callback"]} == usual.written


def test_demonstrations_give_as_many_labels_and_gradient_steps_as_the_usual_cloning() -> None:
    usual, shown = Cloning(), Cloning.of(DEMONSTRATIONS)
    intervals = 100 * usual.seconds
    later = (usual.rounds - 1) * (usual.labels + usual.gait_labels)
    assert shown.rounds == 1
    assert shown.expert_starts * intervals == usual.expert_starts * intervals + later
    assert 2 * shown.gradient_steps == (usual.rounds + 1) * usual.gradient_steps
