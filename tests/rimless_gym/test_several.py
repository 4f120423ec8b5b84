"""Several walkers in one picture, the phase plane, the bars of energy."""

import numpy as np
import pytest

from rimless_gym import BUILDABLE
from rimless_gym.rendering.canvas import FIRST, MUTED, OPTIMUM, PAPER, ROD, STANCE, TEXT
from rimless_gym.rendering.panels import PhasePlane, Shown, draw_several, draw_spending
from rimless_gym.rendering.wheel import Scene

SIZE = (720, 300)


def where(frame, colour, tolerance=8):
    return np.argwhere(np.abs(frame.astype(int) - colour).max(axis=2) <= tolerance)


def walkers(*places):
    scenes = [Scene(phi=1.4, theta=0.4, foot_x=x, speed=0.5, cot=0.05) for x in places]
    return [
        Shown(name=name, colour=colour, scene=scene)
        for name, colour, scene in zip(("one", "two"), (FIRST, OPTIMUM), scenes, strict=False)
    ]


def test_a_ghost_is_drawn_where_it_is():
    alone = draw_several(BUILDABLE, walkers(0.0), SIZE, lines=2)
    for away in (-0.4, 0.4):
        both = draw_several(BUILDABLE, walkers(0.0, away), SIZE, lines=2)
        changed = np.argwhere((alone != both).any(axis=2) & (np.arange(300)[:, None] > 110))
        pixels = np.median(changed[:, 1]) - 360
        assert pixels == pytest.approx(away * 400, rel=0.25)  # 1 m is about 400 pixels here


def test_a_walker_out_of_the_picture_is_named_at_its_edge():
    near, far = (draw_several(BUILDABLE, walkers(0.0, x), SIZE)[-25:] for x in (0.0, 30.0))
    assert not np.array_equal(near, far)
    lit = np.argwhere(far.max(axis=2) > 150)
    assert 600 < lit[:, 1].min() < lit[:, 1].max() < 720


def test_figures_are_written_only_where_there_are_any():
    with_figures = draw_several(BUILDABLE, walkers(0.0), SIZE, averaged="over 5 steps")
    plain = [Shown(name="one", colour=FIRST, scene=Scene(phi=1.4, theta=0.4))]
    without = draw_several(BUILDABLE, plain, SIZE, averaged="over 5 steps")
    corner = np.s_[:100, :250]
    assert len(where(with_figures[corner], TEXT)) > 50
    assert len(where(without[corner], PAPER, 2)) == 100 * 250


def test_the_point_in_the_phase_plane_moves_and_the_cycle_stays():
    cycle = [(1.2, 1.0), (1.5, 3.0), (1.9, 1.0)]
    plane = PhasePlane(BUILDABLE, (0.0, 4.0), cycle, (300, 160))
    low, high = (plane.frame([(FIRST, [(1.5, rate)])]) for rate in (0.5, 3.5))
    points = [where(frame, FIRST).mean(axis=0) for frame in (low, high)]
    assert points[0][0] > points[1][0] + 50  # rows count downwards
    assert points[0][1] == pytest.approx(points[1][1], abs=1)
    assert len(where(low, OPTIMUM)) == pytest.approx(len(where(high, OPTIMUM)), rel=0.2)
    assert len(where(PhasePlane(BUILDABLE, (0, 4), [], (300, 160)).frame([]), OPTIMUM)) == 0


def test_bars_are_as_long_as_their_energies_and_begin_where_the_last_one_ends():
    spent = {"copper": 2.0, "collision": 1.0, "mechanical_change": 1.0}
    frame = draw_spending("energy (J)", {"battery": (4.0, STANCE)}, spent, 8.0, (600, 200))
    battery, terms = where(frame, STANCE), where(frame, ROD)
    assert np.ptp(battery[:, 1]) == pytest.approx(np.ptp(terms[:, 1]), abs=2)
    rows = np.unique(terms[:, 0])
    copper, collision, change = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    spans = [terms[np.isin(terms[:, 0], bar)][:, 1] for bar in (copper, collision, change)]
    assert np.ptp(spans[0]) == pytest.approx(2 * np.ptp(spans[1]), abs=3)
    assert spans[1].min() == pytest.approx(spans[0].max(), abs=2)
    assert spans[2].max() == pytest.approx(battery[:, 1].max(), abs=2)
    assert len(where(frame, MUTED, 60)) > 20  # the title
