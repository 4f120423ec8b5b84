"""A small trial of the study of feedback laws, which several files of tests read."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from scripts.feedback_laws.gaits import GAITS
from scripts.feedback_laws.study import study
from scripts.feedback_laws.subject import subject_of
from trajopt.feedback.catch import catch as catching
from trajopt.feedback.law import Law

HELD = GAITS[2]


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of a finished trial of one law about one gait, with a coarse catch."""
    folder = tmp_path_factory.mktemp("feedback")

    def coarse(law: Law, near: float) -> catching.Catch:
        return catching.Catch.to(law, near, counts=(5, 16, 11, 13))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(catching, "catch_for", coarse)
        study(folder, [HELD], ["lqr"], 1, True)
    yield folder
    subject_of.cache_clear()


@pytest.fixture
def trial(kept: Path) -> dict[str, Any]:
    return dict(json.loads((kept / "results.json").read_text()))
