"""The search of a front: its plans, its files, its measure of agreement, and what it publishes."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Generator, Iterable
from pathlib import Path
from typing import Any

import pytest

from rimless_gym import THESIS_PHYSICAL
from scripts.studies.fronts import command, page, pieces
from scripts.studies.fronts.agreement import disagreements, midpoints
from scripts.studies.fronts.board import Board
from scripts.studies.fronts.campaign import costs, searched
from scripts.studies.fronts.cells import Attempt, Cell, Found, Place, load, save
from scripts.studies.fronts.command import main
from scripts.studies.fronts.crew import while_affordable
from scripts.studies.fronts.drawing import drawn
from scripts.studies.fronts.fine import different, polished
from scripts.studies.fronts.library import record_file
from scripts.studies.fronts.pieces import Family, Join, Lead, Piece, Screen, attempts
from scripts.studies.fronts.plans import families, leads, one_step
from scripts.studies.fronts.polish import Polished
from scripts.studies.fronts.record import SHIPPED, chosen, record
from trajopt.gaits.library import ARCHIVE, index, shipped
from trajopt.gaits.periodic import NoGaitError, periodic_gait
from trajopt.gaits.solution import Solution

#: Spacing of the pretended searches' speeds (m/s).
GRID = 0.1


def known(speed: float = 0.5, turns: int = -1) -> Solution:
    own = [g for g in shipped() if g.params == THESIS_PHYSICAL]
    gaits = [g for g in own if (g.steps, g.theta_turns) == (1, turns)]
    return min(gaits, key=lambda g: abs(g.speed - speed))


def found(speed: float, cot: float, turns: int = -1, steps: int = 1) -> Found:
    """A gait with the first element of a real one as every phase, which keeps its file small."""
    (phase,) = known().phases
    short = dataclasses.replace(
        phase, edges=phase.edges[:2], states=phase.states[:1], controls=phase.controls[:1]
    )
    origin = f"seed 0, random start 0 at {speed:g} m/s"
    return Found(speed, turns, cot, (short,) * steps, origin)


def imagined(piece: Piece) -> list[Attempt]:
    """Gaits of one turn backwards, dearer with speed, up to 0.6 m/s; no others."""
    place = piece.place
    cot = round(0.01 + 0.1 * place.speed, 6)
    good = place.speed < 0.6
    if isinstance(piece, Screen):
        made = []
        for turns, first, starts in piece.families:
            gait = found(place.speed, cot, -1, place.steps) if good and turns == -1 else None
            made += [Attempt(turns, f"start {first + i}", False, gait, 0.01) for i in range(starts)]
        return made
    key = piece.key if isinstance(piece, Join) else piece.gait.key
    gait = found(place.speed, cot, -1, place.steps) if good else None
    return [Attempt(-1, key, True, gait, 0.01)]


@pytest.fixture(autouse=True)
def quick_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do not wait for the disk; no test cuts the power."""
    monkeypatch.setattr(os, "fsync", lambda file: None)


class Pretended:
    """A crew that solves nothing, and is stopped after so many pieces."""

    def __init__(self, most: float = math.inf) -> None:
        self.most, self.pieces = most, list[Piece]()

    def __call__(self, function: Any, inputs: Iterable[Any]) -> Generator[Any, None, None]:
        for piece in inputs:
            if len(self.pieces) >= self.most:
                raise KeyboardInterrupt
            self.pieces.append(piece)
            yield piece, imagined(piece)


# -- agreement ------------------------------------------------------------------------------------


def test_two_seeds_differ_by_what_the_dearer_costs_more() -> None:
    gaps = disagreements({0.2: 0.10, 0.3: 0.05}, {0.2: 0.11, 0.3: 0.05})
    assert gaps == {0.2: pytest.approx(0.1), 0.3: 0.0}


def test_a_gait_that_only_one_seed_found_is_an_infinite_difference() -> None:
    assert disagreements({0.2: 0.1}, {0.3: 0.1}) == {0.2: math.inf, 0.3: math.inf}


def test_speeds_are_added_where_a_front_is_steep_or_ends() -> None:
    grid, front = [0.1, 0.2, 0.3, 0.4], {0.1: 0.10, 0.2: 0.11, 0.3: 0.2}
    assert midpoints(grid, front, 0.05) == pytest.approx([0.25, 0.35])
    assert midpoints(grid, front, 0.1) == []


# -- cells and plans ------------------------------------------------------------------------------


def test_a_cell_read_again_is_the_same(tmp_path: Path) -> None:
    cell = Cell(Place(0, 0.5, 1))
    for attempt in (
        Attempt(-1, "start 0", False, found(0.5, 0.03), 1.5),
        Attempt(0, "start 0", False, None, 0.5),
        Attempt(-1, "another gait", True, found(0.5, 0.02), 0.25),
    ):
        cell = cell.after(attempt)
    save(tmp_path, cell)
    again = load(tmp_path / cell.place.file)
    assert again == cell
    assert [gait.cot for gait in again.gaits] == [0.02, 0.03]
    assert again.starts == {-1: (1, 1), 0: (1, 0)}
    assert again.led == {"another gait"}
    assert again.seconds == 2.25
    assert (again.gaits[0].phases[0].states == cell.gaits[0].phases[0].states).all()


def test_a_gait_that_is_known_already_is_kept_once() -> None:
    cell = Cell(Place(0, 0.5, 1)).with_gait(found(0.5, 0.03))
    assert cell.with_gait(found(0.5, 0.03 * (1 + 1e-5))) == cell
    assert len(cell.with_gait(found(0.5, 0.03, turns=-2)).gaits) == 2


def test_a_side_is_given_up_at_the_first_family_whose_first_start_fails(tmp_path: Path) -> None:
    board, place = Board(THESIS_PHYSICAL, tmp_path), Place(0, 0.5, 1)
    for piece in one_step(0, [0.5], board):
        assert isinstance(piece, Screen)
        board.add(place, imagined(piece)[: 2 if piece.families[0].turns == -1 else None])
    board.add(place, [Attempt(-2, "start 0", False, None, 0.0)])
    backwards = [
        piece.families
        for piece in one_step(0, [0.5], board, rounds=2)
        if isinstance(piece, Screen) and piece.families[0].turns < 0
    ]
    assert backwards == [(Family(-1, 2, 2),)]


def test_families_of_more_steps_lie_within_a_turn_per_step_of_a_good_one_step_gait(
    tmp_path: Path,
) -> None:
    board = Board(THESIS_PHYSICAL, tmp_path)
    board.keep(Cell(Place(0, 0.5, 1)).with_gait(found(0.5, 0.03)))
    board.keep(Cell(Place(0, 0.2, 1)).with_gait(found(0.2, 0.05, turns=-5)))
    assert set(families(board, Place(0, 0.5, 2))) == {0, -1, -2, -3}
    assert 1 not in families(board, Place(0, 0.5, 3))


def test_a_gait_that_was_led_to_a_new_speed_is_not_led_back(tmp_path: Path) -> None:
    board = Board(THESIS_PHYSICAL, tmp_path)
    board.keep(Cell(Place(0, 0.5, 1)).with_gait(found(0.5, 0.03)))
    board.widen([0.45, 0.5, 0.55])
    there = [piece for piece in leads(0, board) if isinstance(piece, Lead)]
    assert [piece.place.speed for piece in there] == [0.45, 0.55]
    board.add(there[0].place, imagined(there[0]), source=0.5)
    assert [piece.place.speed for piece in leads(0, board)] == [0.55]


# -- the search -----------------------------------------------------------------------------------


def test_a_search_of_two_seeds_that_agree_ends_with_a_sweep_that_finds_nothing(
    tmp_path: Path,
) -> None:
    board = Board(THESIS_PHYSICAL, tmp_path)
    (sweep,) = searched(board, GRID, 1000.0, Pretended())
    assert sweep.complete
    assert sweep.gain == pytest.approx(0.0)
    assert costs(board, 0) == costs(board, 1) == costs(board, 2)
    assert max(costs(board, 0)) == pytest.approx(0.6 - GRID / 4)


def test_an_interrupted_search_goes_on_without_what_it_had_finished(tmp_path: Path) -> None:
    whole, first = Pretended(), Pretended(40)
    (tmp_path / "whole").mkdir()
    (tmp_path / "parts").mkdir()
    searched(Board(THESIS_PHYSICAL, tmp_path / "whole"), GRID, 1000.0, whole)
    with pytest.raises(KeyboardInterrupt):
        searched(Board(THESIS_PHYSICAL, tmp_path / "parts"), GRID, 1000.0, first)
    second, board = Pretended(), Board(THESIS_PHYSICAL, tmp_path / "parts")
    searched(board, GRID, 1000.0, second)
    assert not {repr(piece) for piece in first.pieces} & {repr(piece) for piece in second.pieces}
    assert len(first.pieces) + len(second.pieces) == len(whole.pieces)
    assert costs(board, 2) == costs(Board(THESIS_PHYSICAL, tmp_path / "whole"), 2)


def test_a_damaged_cell_is_searched_again(tmp_path: Path) -> None:
    searched(Board(THESIS_PHYSICAL, tmp_path), GRID, 1000.0, Pretended())
    (tmp_path / Place(0, 0.5, 1).file).write_bytes(b"damaged")
    again = Pretended()
    searched(Board(THESIS_PHYSICAL, tmp_path), GRID, 1000.0, again)
    assert again.pieces
    assert {piece.place for piece in again.pieces} <= {Place(0, 0.5, 1)}


def test_a_search_stops_when_its_budget_is_used_up(tmp_path: Path) -> None:
    board = Board(THESIS_PHYSICAL, tmp_path)
    (sweep,) = searched(board, GRID, 1.0, Pretended())
    assert not sweep.complete
    assert board.seconds < 1.0
    assert list(while_affordable([1, 2], lambda: False)) == []


def test_a_gait_led_to_another_speed_costs_there_what_a_fine_mesh_gives() -> None:
    gait, other = known(0.5), known(0.55)
    start = Found(gait.speed, -1, gait.cot, gait.phases, "shipped")
    (attempt,) = attempts(THESIS_PHYSICAL, Lead(Place(0, other.speed, 1), start))
    assert attempt.found is not None
    assert attempt.found.speed == other.speed
    assert attempt.found.cot == pytest.approx(other.cot, rel=1e-2)


def test_a_gait_too_unstable_to_be_verified_does_not_count(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gait = known(0.5)
    lead = Lead(Place(0, 0.51, 1), Found(gait.speed, -1, gait.cot, gait.phases, "shipped"))
    monkeypatch.setattr(pieces, "MOST_GROWTH", 2 * abs(gait.floquet[0]))
    assert attempts(THESIS_PHYSICAL, lead)[0].found is not None
    monkeypatch.setattr(pieces, "MOST_GROWTH", abs(gait.floquet[0]) / 2)
    assert attempts(THESIS_PHYSICAL, lead)[0].found is None


def test_joined_steps_add_their_turns() -> None:
    parts = tuple(
        Found(g.speed, g.theta_turns, g.cot, g.phases, "shipped") for g in (known(0.5), known(0.45))
    )
    (attempt,) = attempts(THESIS_PHYSICAL, Join(Place(0, 0.475, 2), parts))
    assert attempt.turns == -2
    assert attempt.found is not None
    assert attempt.found.steps == 2


# -- what is published ----------------------------------------------------------------------------


def test_a_cheaper_gait_that_was_shipped_before_stays() -> None:
    old, dearer = known(0.5), costing(2 * known(0.5).cot)
    done = [Polished(found(0.5, 0.06), dearer, "", 1.0)]
    assert chosen(done, [old]) == [old]
    assert chosen(done, []) == [dearer]
    assert chosen([done[0]._replace(failure="slips")], [old]) == [old]
    with pytest.raises(NoGaitError, match="--minutes"):
        chosen([done[0]._replace(failure="slips")], [])


class Verified:
    """A crew that verifies every gait, at a cost of transport that a table gives."""

    def __init__(self, cots: dict[int, float]) -> None:
        self.cots, self.solved = cots, list[int]()

    def __call__(self, function: Any, inputs: Iterable[Any]) -> Generator[Any, None, None]:
        for gait in inputs:
            self.solved.append(gait.turns)
            cot = self.cots.get(gait.turns)
            solution = None if cot is None else costing(cot)
            failure = "" if solution else "no gait on a fine mesh"
            yield gait, Polished(gait, solution, failure, 1.0)


def costing(cot: float) -> Solution:
    gait = known()
    energy = gait.verification.electrical_positive * cot / gait.cot
    return dataclasses.replace(
        gait, verification=dataclasses.replace(gait.verification, electrical_positive=energy)
    )


def a_speed_with(cots: dict[int, float], folder: Path) -> Board:
    folder.mkdir()
    board, cell = Board(THESIS_PHYSICAL, folder), Cell(Place(2, 0.5, 1))
    for turns, cot in cots.items():
        cell = cell.with_gait(found(0.5, cot, turns))
    board.keep(cell)
    return board


def test_a_finished_gait_is_not_solved_again(tmp_path: Path) -> None:
    board, crew = a_speed_with({-1: 0.03}, tmp_path / "search"), Verified({-1: 0.03})
    for _ in range(2):
        (done,) = polished(board, tmp_path / "gaits", crew, 60.0)
    assert crew.solved == [-1]
    assert done.solution is not None
    assert done.solution.cot == pytest.approx(0.03)


def test_gaits_are_solved_finely_until_the_next_could_not_be_cheaper(tmp_path: Path) -> None:
    search = {-1: 0.02, -2: 0.03, -3: 0.04, -4: 0.05}
    board, crew = a_speed_with(search, tmp_path / "search"), Verified({-2: 0.045, -3: 0.041})
    done = polished(board, tmp_path / "gaits", crew, 60.0)
    assert crew.solved == [-1, -2, -3]
    assert [each.failure == "" for each in done] == [False, True, True]


def test_a_speed_without_a_verified_gait_gets_one_from_its_neighbours(tmp_path: Path) -> None:
    board = a_speed_with({-1: 0.02}, tmp_path / "search")
    board.keep(Cell(Place(2, 0.6, 1)).with_gait(found(0.6, 0.01, turns=-2)))
    crew = Verified({-1: 0.02})
    done = polished(board, tmp_path / "gaits", crew, 60.0)
    (there,) = [each for each in done if each.gait.speed == 0.6 and not each.failure]
    assert there.gait.turns == -1
    assert there.gait.origin.endswith("led from 0.5 m/s on a fine mesh")


def test_repeated_strides_are_not_solved_finely(tmp_path: Path) -> None:
    board = Board(THESIS_PHYSICAL, tmp_path)
    board.keep(Cell(Place(2, 0.5, 1)).with_gait(found(0.5, 0.03)))
    board.keep(Cell(Place(2, 0.5, 2)).with_gait(found(0.5, 0.03, turns=-2, steps=2)))
    board.keep(Cell(Place(2, 0.5, 3)).with_gait(found(0.5, 0.02, turns=-3, steps=3)))
    assert [gait.steps for gait in different(board, 0.5)] == [3, 1]


def test_the_page_and_the_figure_show_the_record(tmp_path: Path) -> None:
    (tmp_path / "search").mkdir()
    board = Board(THESIS_PHYSICAL, tmp_path / "search")
    sweeps = searched(board, GRID, 1000.0, Pretended())
    gaits = [dataclasses.replace(known(speed), provenance={}) for speed in (0.45, 0.5)]
    text = record("TRIAL", board, gaits, [], sweeps, 10.0, 1)
    assert json.loads(json.dumps(text, allow_nan=False)) == text
    assert [row["found_by"] for row in text["front"]] == [SHIPPED, SHIPPED]
    path = tmp_path / "front.md"
    path.write_text("# Fronts\n")
    page.refresh(path, text)
    once = path.read_text()
    page.refresh(path, text)
    assert path.read_text() == once
    assert "agree within" in once
    assert drawn(text).axes


def test_another_machine_in_the_same_folder_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "THESIS_PHYSICAL_CHANGED"
    folder.mkdir()
    (folder / "machine.json").write_text("{}")
    machine = ["--preset", "THESIS_PHYSICAL", "--params", '{"gear_ratio": 250}']
    with pytest.raises(SystemExit):
        main([*machine, "--out", str(tmp_path)])
    assert "another machine" in capsys.readouterr().err


def test_a_search_without_the_record_of_its_machine_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "THESIS_PHYSICAL_CHANGED" / "search").mkdir(parents=True)
    machine = ["--preset", "THESIS_PHYSICAL", "--params", '{"gear_ratio": 250}']
    with pytest.raises(SystemExit):
        main([*machine, "--out", str(tmp_path)])
    refusal = capsys.readouterr().err
    assert "machine.json" in refusal
    assert "give another --out" in " ".join(refusal.split())


# -- shipped fronts -------------------------------------------------------------------------------


def recorded() -> list[tuple[str, dict[str, Any]]]:
    """The fronts of the shipped records, some speeds of each."""
    rows = []
    for path in sorted(ARCHIVE.parent.glob(record_file("*"))):
        content = json.loads(path.read_text())
        rows += [(content["machine"], row) for row in content["front"]]
    return rows


def test_every_gait_of_a_recorded_front_is_shipped() -> None:
    assert recorded()
    for _, row in recorded():
        same = [g.cot for g in index() if round(g.speed, 4) == row["speed"]]
        assert row["cot"] in same


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.75, 1.0])
def test_a_periodic_gait_is_never_dearer_than_the_searched_front(share: float) -> None:
    rows = recorded()
    name, row = rows[round(share * (len(rows) - 1))]
    gaits = [g for g in index() if round(g.speed, 4) == row["speed"]]
    params = next(g.params for g in gaits if g.cot == row["cot"])
    gait = periodic_gait(params, row["speed"], row["steps"])
    assert gait.verification.passed, name
    assert gait.cot <= row["cot"] * 1.005


@pytest.mark.parametrize(
    ("arguments", "folder", "shipped"),
    [([], "BUILDABLE", True), (["--params", '{"friction": 0.7}'], "BUILDABLE_CHANGED", False)],
    ids=["preset", "trial"],
)
def test_only_a_search_of_a_preset_itself_is_shipped(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    folder: str,
    shipped: bool,
) -> None:
    into: list[Path] = []

    def searched(name: str, params: Any, place: Path, options: Any, library: Path) -> Any:
        into.extend([place, library])
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "_searched", searched)
    assert main([*arguments, "--out", str(tmp_path)]) == command.INTERRUPTED
    assert into[0] == tmp_path / folder
    assert (into[1] == ARCHIVE.parent) == shipped


def test_a_shorter_search_does_not_replace_the_record_of_a_longer_one(tmp_path: Path) -> None:
    path = tmp_path / "machine_front.json"
    path.write_text(json.dumps({"minutes": {"search_of_one_core": 70.0}}))
    command.require_more_search({"minutes": {"search_of_one_core": 70.0}}, path)
    with pytest.raises(ValueError, match=r"searched for 70 minutes.*more --minutes"):
        command.require_more_search({"minutes": {"search_of_one_core": 1.0}}, path)
