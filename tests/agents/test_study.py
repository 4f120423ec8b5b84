from __future__ import annotations

import math

import pytest

from agents.comparison.study import Study


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"preset": "x"}, ValueError, "unknown preset 'x': choose from"),
        ({"preset": 3}, TypeError, "preset = 3"),
        ({"speed": math.nan}, ValueError, "speed = nan"),
        ({"steps": 1.5}, TypeError, "steps = 1.5"),
        ({"seed": -1}, ValueError, "seed = -1"),
        ({"timesteps": math.inf}, TypeError, "timesteps = inf"),
        ({"starts": None}, TypeError, "starts = None"),
        ({"front": ()}, TypeError, "front = "),
        ({"front": (0.5, math.nan)}, ValueError, "front: speed = nan"),
        ({"front": 0.5}, TypeError, "front = 0.5"),
    ],
)
def test_invalid_settings_are_refused_by_name(
    settings: dict, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        Study(**settings)


def test_a_front_from_json_is_a_tuple() -> None:
    assert Study(front=[0.5, 0.6]) == Study(front=(0.5, 0.6))  # type: ignore[arg-type]
