"""The rows of the study."""

from __future__ import annotations

import json
import pickle

from rimless_gym.commands.studies.cells import Cell
from rimless_gym.commands.studies.rows import ROWS


def test_every_row_has_a_name_of_its_own_and_plain_settings_and_goes_to_other_processes() -> None:
    assert len({row.name for row in ROWS}) == len(ROWS)
    for row in ROWS:
        for trial in (row.trial, row.trial.brief()):
            assert json.loads(json.dumps(trial.settings)) == trial.settings
        assert pickle.loads(pickle.dumps({Cell(row, 0): 1})) == {Cell(row, 0): 1}
