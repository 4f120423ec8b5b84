"""The optima that a study compares with."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from rimless_gym import BUILDABLE
from scripts.studies.learning import optima
from scripts.studies.learning.figures import Figures
from tests.scripts.studies.learning.toys import STANDS


def test_the_gap_is_to_the_optimum_at_the_learned_speed(tmp_path: Path) -> None:
    @dataclasses.dataclass(frozen=True)
    class Gait:
        speed: float
        cot: float

    def best_held(params: Any, ticks: int, folder: Path) -> Any:
        return Gait(params.step_length / (0.01 * ticks), 0.05 + 0.001 * (ticks - 40))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(optima, "best_held", best_held)
        on_a_tick = BUILDABLE.step_length / 0.45
        policy = Figures(1.0, 0.0, 0.0, cot=0.066, speed=on_a_tick + 1e-9)
        between = dataclasses.replace(policy, speed=on_a_tick * 45 / 45.5)
        found = optima.Optima(BUILDABLE, [policy, between, STANDS], tmp_path, 1)
        assert found.gap(policy) == pytest.approx(0.066 / 0.055 - 1, abs=1e-5)
        assert found.gap(between) == pytest.approx(0.066 / 0.0555 - 1, abs=1e-3)
        assert found.gap(STANDS) is None
