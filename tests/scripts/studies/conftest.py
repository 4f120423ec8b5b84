"""A small trial of the study of feedback laws, which several files of tests read."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from scripts.studies.feedback_laws import sizes
from scripts.studies.feedback_laws.gaits import GAITS
from scripts.studies.feedback_laws.study import study
from trajopt.feedback import startup
from trajopt.feedback.law import Law

HELD = GAITS[2]


#: Enough for figures of every column; what they say is of no account.
FEWEST = dataclasses.replace(
    sizes.FOR_A_TRIAL,
    starts=2,
    few_starts=2,
    phases=1,
    impulses=2,
    bisections=1,
    states=4,
    slope_step=5.0,
    slope_starts=1,
    deviations=2,
    shorter=20.0,
)


def finished(folder: Path, numbers: sizes.Sizes) -> None:
    """Finish a trial of one law about one gait in a folder, with a coarse start-up controller."""

    def coarse(law: Law, near: float, folder: Path | None = None) -> startup.StartUpController:
        return startup.StartUpController.to(law, near, counts=(5, 16, 11, 13))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(startup, "startup_for", coarse)
        patch.setattr(sizes, "FOR_A_TRIAL", numbers)
        study(folder, [HELD], ["lqr"], 1, True)


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished trial that measured as little as possible."""
    folder = tmp_path_factory.mktemp("feedback")
    finished(folder, FEWEST)
    return folder


@pytest.fixture
def trial(kept: Path) -> dict[str, Any]:
    return dict(json.loads((kept / "results.json").read_text()))


@pytest.fixture(scope="session")
def measured(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The figures of a trial as the command line makes it: they tell of the law."""
    folder = tmp_path_factory.mktemp("measured")
    finished(folder, sizes.FOR_A_TRIAL)
    return dict(json.loads((folder / "results.json").read_text()))
