"""Names beside points: none covers another."""

from __future__ import annotations

import itertools

import matplotlib.pyplot as plt
import numpy as np
import pytest
from agents.comparison.labels import Named, spread, write_names
from matplotlib.text import Text


def test_names_that_have_room_stay_at_their_points() -> None:
    assert spread([1.0, 3.0, 9.0], 1.5, 0.0, 10.0) == [1.0, 3.0, 9.0]


def test_crowded_names_move_apart_around_their_middle() -> None:
    assert spread([5.0, 5.0, 5.0], 1.0, 0.0, 10.0) == pytest.approx([4.0, 5.0, 6.0])
    assert spread([0.0, 5.0, 5.2], 1.0, -9.0, 99.0) == pytest.approx([0.0, 4.6, 5.6])


def test_names_stay_within_the_plot_and_apart() -> None:
    wanted = np.sort(np.random.default_rng(0).uniform(0.0, 10.0, 12)).tolist()
    places = spread(wanted, 0.8, 0.0, 10.0)
    assert min(places) >= 0.0
    assert max(places) <= 10.0 + 1e-9
    assert np.diff(places).min() >= 0.8 - 1e-9


@pytest.mark.parametrize("apart", [4.0, 2.0, 1.0], ids=["far", "within a name", "near"])
def test_no_name_covers_another(apart: float) -> None:
    figure, axes = plt.subplots()
    axes.set(xlim=(0, 10), ylim=(0, 1))
    places = (1.0, 1.0 + apart)
    points = [Named(x, 0.5, f"policy {x} {k}", "black") for x in places for k in range(9)]
    points[0] = points[0]._replace(name="a policy with a name of many words")
    write_names(axes, points)
    figure.canvas.draw()
    assert {text.get_text() for text in axes.texts} == {point.name for point in points}
    boxes = [Text.get_window_extent(text) for text in axes.texts]  # without the lines to points
    plt.close(figure)
    assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
