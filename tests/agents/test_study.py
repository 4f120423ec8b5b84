from __future__ import annotations

import math

import pytest

from agents.comparison.study import Study
from rimless_gym import BUILDABLE
from rimless_gym.hybrid import CONTROL_PERIOD


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
        ({"front": ()}, ValueError, "front = .*two speeds"),
        ({"front": (0.6, 0.5)}, ValueError, "front = .*the least and the greatest"),
        ({"front": (0.5, math.nan)}, ValueError, "front: speed = nan"),
        ({"front": 0.5}, TypeError, "front = 0.5"),
        ({"further": (-1.0,)}, ValueError, "further: speed = -1.0"),
        ({"further": (0.561,)}, ValueError, "stand for the same gait"),
        ({"speed": 9.0}, ValueError, r"speed = 9(\.\d+)? m/s: the motor is too weak"),
        ({"front_steps": ()}, TypeError, r"front_steps = \(\): must be a tuple such as \(1, 2\)"),
        ({"front_steps": 2}, TypeError, "front_steps = 2"),
        ({"front_steps": (0,)}, ValueError, "front_steps: number = 0"),
    ],
)
def test_invalid_settings_are_refused_by_name(
    settings: dict, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        Study(**settings)


def test_speeds_from_json_are_tuples() -> None:
    listed = Study(front=[0.5, 0.6], further=[0.5], front_steps=[1])  # type: ignore[arg-type]
    assert listed == Study(front=(0.5, 0.6), further=(0.5,), front_steps=(1,))


def test_the_front_has_every_speed_at_which_laws_walk() -> None:
    study = Study(front=(0.55, 0.58), further=(0.5, 0.62))
    assert {study.on_tick(speed) for speed in study.speeds} <= set(study.front_speeds)
    ticks = [BUILDABLE.step_length / speed / CONTROL_PERIOD for speed in study.front_speeds]
    assert ticks == pytest.approx(range(round(ticks[0]), round(ticks[-1]) - 1, -1))


def test_a_front_beyond_every_gait_is_refused_before_any_work():
    with pytest.raises(ValueError, match="at most"):
        Study(front=(0.01, 20.0))
