"""What the tests of the study over seeds share."""

from __future__ import annotations

import pytest

from scripts.studies.learning import optima


@pytest.fixture
def no_gaits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(optima, "best_held", lambda params, ticks, folder: None)
