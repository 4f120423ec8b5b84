"""Several walks in one picture, and where the energy goes."""

import dataclasses

import numpy as np
import pytest

from agents.energies import chapters, drawn_between, spent_between
from agents.race import AHEAD, MOST, Race, ghost
from agents.recording import record_walker
from agents.walkers import walker
from rimless_gym import BUILDABLE
from rimless_gym.equations import LOSSES
from rimless_gym.rendering.canvas import OPTIMUM
from rimless_gym.rendering.panels import draw_spending
from trajopt import periodic_gait


@pytest.fixture(scope="module")
def walk():
    return record_walker(walker("evolution", None), 6.0)


@pytest.fixture(scope="module")
def gait():
    return periodic_gait(BUILDABLE, 0.56, 1, hold=0.01)


def coloured(frame, colour):
    return int((np.abs(frame.astype(int) - colour).max(axis=2) <= 8).sum())


@pytest.mark.parametrize("size", [(360, 234), (501, 333)])
def test_frames_have_the_size_that_was_asked_for(walk, gait, size):
    race = Race([walk, ghost(gait, walk)], gait, size)
    for time in (0.0, 1.0, 5.9):
        frame = race.frame(time)
        assert (frame.shape, frame.dtype) == ((size[1], size[0], 3), np.uint8)


def test_the_optimum_joins_in_step_once_the_first_walks(walk, gait):
    optimum, first = ghost(gait, walk), walk.measured_from
    assert 0.0 <= optimum.begins - first.time < 0.01
    assert optimum.touchdowns[0] == pytest.approx((first.time, 1, first.foot + AHEAD))
    without, both = Race([walk], None), Race([walk, optimum], None)
    early, late = (coloured(both.frame(t), OPTIMUM) for t in (optimum.begins - 0.1, 5.0))
    assert early == 0
    assert late > 100  # its name, its figures or its battery's bar
    assert coloured(without.frame(5.0), OPTIMUM) == 0


@pytest.mark.parametrize(("since", "time"), [(0.0, 0.5), (0.0, 3.0), (3.0, 6.0)])
def test_the_terms_add_up_to_what_the_battery_gave(walk, since, time):
    spent = spent_between(walk, since, time)
    assert set(LOSSES) <= set(spent)
    assert not any("_" in term for term in spent)  # they are written beside the bars
    assert sum(spent.values()) == pytest.approx(drawn_between(walk, since, time), abs=1e-9)
    assert spent["copper"] == walk.spent(time)["copper"] - walk.spent(since)["copper"]


def test_energies_are_counted_anew_once_the_wheel_walks(walk, monkeypatch):
    start, walking = chapters(walk)
    assert (start.since, walking.since, walking.until) == (0.0, walk.measured_from.time, walk.ends)
    assert "drag" not in walking.terms  # this machine has none
    drawn = []
    monkeypatch.setattr("agents.energies.draw_spending", lambda *given: drawn.append(given))
    start.frame(start.until, (), (300, 160))
    walking.frame(walking.since, (), (300, 160))
    walking.frame(walk.ends, (), (300, 160))
    batteries = [given[1]["battery"][0] for given in drawn]
    assert batteries[1] == 0.0
    assert 0.0 < batteries[2] < batteries[0]
    for _, _, spent, full, _ in drawn:
        assert max(np.cumsum(list(spent.values()))) <= full + 1e-9  # no bar leaves the picture


def test_bars_of_costlier_walkers_fit_into_the_picture_too(walk, monkeypatch):
    fulls = []
    monkeypatch.setattr("agents.energies.draw_spending", lambda *given: fulls.append(given[3]))
    costly = dataclasses.replace(walk, name="costly", books=3.0 * walk.books)
    part = chapters(walk)[-1]
    for rivals in ((), [(costly, OPTIMUM)]):
        part.frame(4.0, rivals, (300, 160))
    assert fulls[0] == part.full
    assert fulls[1] == pytest.approx(3.0 * drawn_between(walk, part.since, part.until))


def test_the_path_of_a_file_leaves_room_for_the_bars(walk, monkeypatch):
    named = []
    monkeypatch.setattr("agents.energies.draw_spending", _noting(named))
    path = "/somebody/keeps/policies/far/away/from/here/runs/ppo/best.zip"
    Race([walk, dataclasses.replace(walk, name=path)], None).frame(4.0)
    assert list(named[0]) == ["battery", "battery, ...e/runs/ppo/best.zip"]


def _noting(named):
    """What draws bars, and notes the batteries."""

    def draw(title, drawn, spent, full, size):
        named.append(drawn)
        return draw_spending(title, drawn, spent, full, size)

    return draw


def test_a_picture_that_is_too_flat_for_the_names_is_refused(walk):
    with pytest.raises(ValueError, match=r"size = 2000 x 32 pixels: .* make the picture higher"):
        Race([walk], None, (2000, 50)).frame(0.0)


def test_too_many_walkers_and_those_of_other_machines_are_refused(walk):
    with pytest.raises(ValueError, match=f"{MOST + 1} walkers: at most {MOST}"):
        Race([walk] * (MOST + 1), None)
    other = dataclasses.replace(walk, name="heavy", params=BUILDABLE.replace(wheel_mass=2.0))
    with pytest.raises(ValueError, match="heavy: walks with another machine than evolution"):
        Race([walk, other], None)
