"""A walk as pictures."""

import numpy as np
import pytest

from agents.film import film, times
from agents.policy_files import named_policy
from agents.recording import record_policy


@pytest.fixture(scope="module")
def walk():
    return record_walker(walker("evolution", None), 4.0)


@pytest.mark.parametrize("fps", [4, 10])
def test_a_film_lasts_as_long_as_its_walk(walk, fps):
    frames = list(film(walk, fps=fps, size=(120, 80)))
    assert len(frames) == 4 * fps
    assert all(frame.shape == (80, 120, 3) and frame.dtype == np.uint8 for frame in frames)


def test_no_figures_are_shown_at_first_and_later_over_what_they_are(walk, monkeypatch):
    scenes = []
    monkeypatch.setattr("agents.film.draw", lambda params, scene, **_: scenes.append(scene))
    list(film(walk, fps=10))
    assert all(scene.cot is None and scene.speed is None for scene in scenes[:20])
    assert 0.03 < scenes[-1].cot < 1.0
    assert scenes[-1].averaged == "over 5 steps"


def test_a_short_walk_has_one_picture():
    assert times(0.01, 25) == [0.0]
