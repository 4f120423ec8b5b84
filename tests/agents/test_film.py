"""Walks as pictures."""

import numpy as np
import pytest

from agents.conditions import Conditions
from agents.film import AVERAGED, film, film_of_gait
from agents.policies import learned_policy
from agents.policy_files import load_policy
from agents.rollout import Rollout, at_rest
from rimless_gym import BUILDABLE
from trajopt import periodic_gait

SIZE = (120, 80)


def walk(seconds):
    policy = learned_policy(load_policy("evolution").act)
    start = at_rest(BUILDABLE)[None]
    return Rollout(Conditions(BUILDABLE), policy, start, round(seconds / 0.01))


@pytest.mark.parametrize(("period", "fps"), [(0.01, 25), (0.04, 10), (0.04, 50), (0.03, 25)])
def test_a_film_lasts_as_long_as_its_walk(period, fps):
    frames = list(film(BUILDABLE, list(walk(1.2)), fps=fps, size=SIZE, period=period))
    assert len(frames) == pytest.approx(120 * period * fps, abs=1)
    assert all(frame.shape == (80, 120, 3) and frame.dtype == np.uint8 for frame in frames)


def test_no_figures_are_shown_before_the_wheel_has_gone_somewhere(monkeypatch):
    scenes = []
    monkeypatch.setattr("agents.film.draw", lambda params, scene, **_: scenes.append(scene))
    list(film(BUILDABLE, walk(5.0), fps=10, size=SIZE))
    assert scenes[0].cot is None
    assert scenes[0].speed is None
    rolling = [scene for scene in scenes if scene.cot is not None]
    assert rolling
    assert all(0.03 < scene.cot < 3.0 and scene.speed > 0.0 for scene in rolling)


def test_the_figures_are_those_of_the_last_seconds(monkeypatch):
    scenes = []
    monkeypatch.setattr("agents.film.draw", lambda params, scene, **_: scenes.append(scene))
    intervals = list(walk(5.0))
    list(film(BUILDABLE, intervals, fps=100, size=SIZE))
    last, n = scenes[-1], round(AVERAGED / 0.01)
    before = intervals[-n - 1 : -1]
    distance = sum(float(i.info["distance"][0]) for i in before)
    energy = sum(float(i.info["electrical_positive"][0] + i.info["idle"][0]) for i in before)
    assert last.speed == pytest.approx(distance / AVERAGED)
    assert last.cot == pytest.approx(energy / (BUILDABLE.weight * distance))


def test_a_gait_walks_on_from_stride_to_stride(monkeypatch):
    scenes = []
    monkeypatch.setattr("agents.film.draw", lambda params, scene, **_: scenes.append(scene))
    gait = periodic_gait(BUILDABLE, 0.56, 1)
    list(film_of_gait(gait, 4.0, fps=25, size=SIZE))
    hubs = np.array([scene.hub(BUILDABLE)[0] for scene in scenes])
    assert (np.diff(hubs) > 0.0).all()
    assert (hubs[-1] - hubs[0]) / (3.96) == pytest.approx(gait.speed, rel=0.05)
