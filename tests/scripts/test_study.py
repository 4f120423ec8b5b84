"""The study over seeds, with trainings that take no time."""

from __future__ import annotations

import dataclasses
import json
import os
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from agents import learners
from agents.folder import BEST, CLONE, LAST
from agents.policy_files import PRETRAINED, read_record
from agents.protocol import PROTOCOL
from agents.statistics import interquartile_mean
from agents.train import TrainResult, train
from agents.training import IMITATION, SCRATCH
from rimless_gym import BUILDABLE, THESIS_PHYSICAL
from scripts.studies import command, optima, page, running, trials
from scripts.studies.cells import RESULT, Cell, Result, kept
from scripts.studies.estimate import Estimate
from scripts.studies.figures import Figures
from scripts.studies.first_evening import POLICY, FirstEvening
from scripts.studies.rows import DISTURBED, FIRST_EVENING, FRONT, LEARNED, ROWS, Row
from scripts.studies.running import completed, ran
from scripts.studies.stopwatch import forget, minutes, timed
from scripts.studies.study import Study, run
from scripts.studies.summary import lines
from scripts.studies.trials import Distilled, Disturbed, Following, Trained

PAGE = Path(__file__).resolve().parents[2] / "docs" / "learning.md"

#: Two short walks.
FEW = dataclasses.replace(PROTOCOL, starts=2, duration=1.0, window=0.5, alive=0.5)

STANDS = Figures(share=0.0, falls=0.0, slips=0.0, cot=None, speed=None)


@dataclasses.dataclass(frozen=True)
class Toy:
    """A training that counts to ten, and may be stopped before it gets there.

    Its policy walks as its seed says: those of `standing` seeds stand.
    """

    standing: tuple[int, ...] = ()
    stops_at: int | None = None
    fails: bool = False

    @property
    def settings(self) -> dict[str, Any]:
        return {"standing": list(self.standing)}

    def train(self, seed: int, folder: Path, params: Any) -> int:
        if self.fails:
            raise ValueError("this learner cannot learn")
        assert os.cpu_count() == 1
        counted = folder / "counted"
        with counted.open("a") as file:
            for _ in range(len(counted.read_text()), 10):
                if len(counted.read_text()) == self.stops_at:
                    raise KeyboardInterrupt
                file.write(f"{seed}")
                file.flush()
        return 1000 * (seed + 1)

    def judge(self, folder: Path, params: Any, by: Any) -> dict[str, Figures]:
        seed = int(folder.name.rpartition("_")[2])
        walks = Figures(share=1.0, falls=0.0, slips=0.0, cot=0.06 + 0.001 * seed, speed=0.56)
        return {"best": STANDS if seed in self.standing else walks, "last": walks}

    def brief(self) -> Toy:
        return self


def toy(name: str = "toy", table: str = LEARNED, **fields: Any) -> Row:
    return Row(name, f"a {name}", table, Toy(**fields))


def cells_of(row: Row, seeds: int = 3) -> list[Cell]:
    return Study((row,), seeds, BUILDABLE).cells()


@pytest.fixture
def no_gaits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(optima, "best_held", lambda params, ticks, folder: None)


def test_a_study_that_was_interrupted_goes_on_where_it_was(tmp_path: Path) -> None:
    class Stopping:
        def __init__(self) -> None:
            self.done = 0

        def __call__(self, cell: Cell, folder: Path) -> Result | str:
            self.done += 1
            return cell.run(folder) if self.done < 3 else stopped(cell).run(folder)

    def stopped(cell: Cell) -> Cell:
        trial = dataclasses.replace(cell.row.trial, stops_at=4)  # type: ignore[type-var]
        return dataclasses.replace(cell, row=dataclasses.replace(cell.row, trial=trial))

    cells = cells_of(toy(), 5)
    with pytest.raises(KeyboardInterrupt):
        completed(tmp_path, cells, 1, Stopping())
    assert [kept(tmp_path, cell) is not None for cell in cells] == [True, True] + 3 * [False]
    assert (tmp_path / "toy_2" / "counted").read_text() == "2222"
    again: list[str] = []

    def noting(cell: Cell, folder: Path) -> Result | str:
        again.append(cell.key)
        return ran(cell, folder)

    results, failures = completed(tmp_path, cells, 1, noting)
    assert (again, failures) == (["toy_2", "toy_3", "toy_4"], {})
    assert (tmp_path / "toy_2" / "counted").read_text() == 10 * "2"
    untouched, _ = completed(tmp_path / "untouched", cells, 1)
    assert list(results) == list(untouched) == cells
    assert [r.policies for r in results.values()] == [r.policies for r in untouched.values()]
    assert [result.steps for result in results.values()] == [1000, 2000, 3000, 4000, 5000]


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[:30],
        lambda text: "[]",
        lambda text: "",
        lambda text: text.replace('"share": 1.0', '"share": 0.99'),
    ],
    ids=["cut", "list", "empty", "edited"],
)
def test_a_damaged_cell_is_refused_with_a_remedy(
    damage: Callable[[str], str], tmp_path: Path
) -> None:
    cells = cells_of(toy(), 2)
    completed(tmp_path, cells, 1)
    path = tmp_path / "toy_1" / RESULT
    path.write_text(damage(path.read_text()))
    remedy = f"remove it to judge its policies again, or remove {path.parent} to train them anew"
    with pytest.raises(ValueError, match="damaged") as refusal:
        completed(tmp_path, cells, 1)
    assert str(path) in str(refusal.value)
    assert remedy in str(refusal.value)
    path.unlink()
    assert len(completed(tmp_path, cells, 1)[0]) == 2
    assert (path.parent / "counted").read_text() == 10 * "1"  # it was not trained again


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"params": THESIS_PHYSICAL}, "params"),
        ({"protocol": dataclasses.replace(PROTOCOL, starts=4)}, "protocol"),
        ({"row": toy(standing=(7,))}, "trial"),
    ],
)
def test_a_cell_that_was_made_in_another_way_is_refused(
    changes: dict[str, Any], named: str, tmp_path: Path
) -> None:
    (cell,) = cells_of(toy(), 1)
    completed(tmp_path, [cell], 1)
    with pytest.raises(ValueError, match=rf"of another {named} .*choose another --out"):
        kept(tmp_path, dataclasses.replace(cell, **changes))


def test_cells_of_another_revision_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cells = cells_of(toy(), 1)
    completed(tmp_path, cells, 1)
    monkeypatch.setattr(running, "provenance", lambda: {"git_revision": "later"})
    completed(tmp_path, cells, 1)
    assert "toy_0: made by another revision than later" in capsys.readouterr().err


def test_a_seed_that_fails_does_not_stop_the_others_and_is_tried_again(
    tmp_path: Path, no_gaits: None
) -> None:
    study = Study((toy("broken", fails=True), toy("sound")), 2, BUILDABLE)
    found = run(study, ["broken", "sound"], tmp_path, 1)
    assert found.failures == dict.fromkeys(
        ("broken_0", "broken_1"), "ValueError: this learner cannot learn"
    )
    assert found.unfinished == ("broken (0 of 2 seeds)",)
    assert "a sound" in found.sections[LEARNED]
    assert "a broken" not in found.sections[LEARNED]
    assert not (tmp_path / "broken_0" / RESULT).exists()


def test_the_table_counts_the_seeds_that_do_not_walk_and_averages_over_the_others(
    tmp_path: Path,
) -> None:
    results, _ = completed(tmp_path, cells_of(toy(standing=(1, 3)), 10), 1)
    best, last = lines(
        results, lambda row, policy: None if policy.cot is None else policy.cot / 0.05 - 1
    )
    assert (best.walking, best.seeds, last.walking) == (8, 10, 10)
    walking = [0.06 + 0.001 * seed for seed in range(10) if seed not in (1, 3)]
    assert best.cot is not None
    assert best.gap is not None
    assert best.cot.mean == pytest.approx(interquartile_mean(walking))
    assert best.gap.mean == pytest.approx(interquartile_mean(walking) / 0.05 - 1)
    assert best.gap.low < best.gap.mean < best.gap.high
    assert (best.least, best.middle, best.most) == (0.0, 1.0, 1.0)
    text = page.learned_table([best])
    assert "| a toy, best | 8 of 10 | 100 % (0 to 100) | +31.0 % (+" in text


def test_a_row_of_which_no_seed_walks_has_no_averages(tmp_path: Path) -> None:
    results, _ = completed(tmp_path, cells_of(toy(standing=(0, 1)), 2), 1)
    best, _ = lines(results, lambda row, policy: 0.1)
    assert (best.gap, best.cot, best.speed, best.walking) == (None, None, None, 0)
    assert "| a toy, best | 0 of 2 | 0 % (0 to 0) | - | - | - |" in page.learned_table([best])


def test_rows_that_were_finished_before_stay_in_the_tables(tmp_path: Path, no_gaits: None) -> None:
    study = Study((toy("first"), toy("second", FIRST_EVENING, standing=(0,))), 2, BUILDABLE)
    first = run(study, ["first"], tmp_path, 1)
    assert first.unfinished == ("second (0 of 2 seeds)",)
    assert list(first.sections) == [LEARNED]
    both = run(study, ["second"], tmp_path, 1)
    assert both.unfinished == ()
    assert both.sections[LEARNED] == first.sections[LEARNED]
    evening = both.sections[FIRST_EVENING]
    assert "| a second | best | 1 of 2 | 50 % (0 to 100) |" in evening
    assert "| a second | last | 2 of 2 |" in evening
    assert "| a second | all of these | 1 of 2 |" in evening
    written = json.loads((tmp_path / "results.json").read_text())
    assert written["cells"]["second_0"]["policies"]["best"]["share"] == 0.0


def test_a_row_tells_of_its_first_seeds_if_they_are_at_least_three(
    tmp_path: Path, no_gaits: None
) -> None:
    long, short = toy("long"), toy("short")
    five = Study((long, short), 5, BUILDABLE)
    completed(tmp_path, [*Study((long,), 4, BUILDABLE).cells(), *cells_of(short, 2)], 1)
    completed(tmp_path, [Cell(short, 4)], 1)
    found = run(five, [], tmp_path, 1)
    assert "| a long, best | 4 of 4 |" in found.sections[LEARNED]
    assert "short" not in found.sections[LEARNED]
    assert found.unfinished == ("long (4 of 5 seeds)", "short (0 of 5 seeds)")


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


def test_the_time_of_a_training_counts_on_through_stops(tmp_path: Path) -> None:
    def work() -> float:
        with timed(tmp_path):
            sum(range(2_000_000))
        return minutes(tmp_path)

    first = work()
    assert 0.0 < first < work()
    forget(tmp_path)
    assert minutes(tmp_path) == 0.0
    (tmp_path / "minutes.json").write_text("{")
    with pytest.raises(ValueError, match=r"damaged.*to train anew"):
        work()


def test_the_time_that_is_left_follows_from_the_cells_that_are_finished() -> None:
    first, second, third = cells_of(toy(), 3)
    estimate = Estimate([first, second, third], {}, 2)
    assert estimate.minutes == pytest.approx(1.5 * toy().minutes, rel=0.01)
    estimate.finished(first, Result({}, 0, minutes=40.0))
    assert estimate.minutes == pytest.approx(40.0, rel=0.01)
    estimate.finished(second, None)
    estimate.finished(third, Result({}, 0, minutes=40.0))
    assert estimate.words == ""


def test_every_row_has_a_name_of_its_own_and_plain_settings_and_goes_to_other_processes() -> None:
    assert len({row.name for row in ROWS}) == len(ROWS)
    for row in ROWS:
        for trial in (row.trial, row.trial.brief()):
            assert json.loads(json.dumps(trial.settings)) == trial.settings
        assert pickle.loads(pickle.dumps({Cell(row, 0): 1})) == {Cell(row, 0): 1}


def test_a_training_by_agents_train_is_judged_from_its_own_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def trained(algo: str, init: str, seed: int, out: Path, **others: Any) -> TrainResult:
        for shipped, file in (("imitation", CLONE), ("evolution", BEST)):
            shutil.copy(PRETRAINED[shipped], out / file)
        stopped = others["timesteps"] == 1
        return TrainResult(out / BEST, out / LAST, out / CLONE, 4096, stopped, ())

    monkeypatch.setattr(trials, "train", trained)
    few = dataclasses.replace(PROTOCOL, starts=2, duration=12.0, window=4.0, alive=2.0)
    trial = Trained("ppo", IMITATION, 4096, (("clone", CLONE), ("best kept", BEST)))
    cell = Cell(Row("learner", "learner", LEARNED, trial), 0, protocol=few)
    result = cell.run(tmp_path)
    clone, best = result.policies["clone"], result.policies["best kept"]
    assert (clone.share, best.share, result.steps) == (1.0, 1.0, 4096)
    assert clone.cot is not None
    assert best.cot is not None
    assert clone.cot < best.cot
    row = dataclasses.replace(cell.row, trial=dataclasses.replace(trial, timesteps=1))
    with pytest.raises(KeyboardInterrupt):
        dataclasses.replace(cell, row=row).run(tmp_path)


def test_a_distilled_policy_is_taught_by_the_other_row_of_its_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[dict[str, Any]] = []

    def trained(algo: str, init: str, seed: int, out: Path, **others: Any) -> TrainResult:
        asked.append(others)
        return TrainResult(out / BEST, out / LAST, out / CLONE, 0, False, ())

    monkeypatch.setattr(trials, "train", trained)
    trial = Distilled("ppo", IMITATION, 0, teacher="evolution")
    (own := tmp_path / "distilled_3").mkdir()
    with pytest.raises(ValueError, match=r"evolution_3 is not finished.*--rows evolution"):
        trial.train(3, own, BUILDABLE)
    (tmp_path / "evolution_3").mkdir()
    (tmp_path / "evolution_3" / RESULT).touch()
    trial.train(3, own, BUILDABLE)
    assert asked[0]["expert"] == str(tmp_path / "evolution_3" / BEST)


def test_a_first_evening_is_trained_once_and_judged_at_every_command(tmp_path: Path) -> None:
    trial = FirstEvening("SAC", n_envs=1, timesteps=1, commands=(0.35, 0.6))
    cell = Cell(Row("evening", "evening", FIRST_EVENING, trial), 0, protocol=FEW)
    first = cell.run(tmp_path)
    assert list(first.policies) == ["0.35 m/s", "0.6 m/s"]
    policy = tmp_path / "evening_0" / POLICY
    before = policy.stat().st_mtime_ns
    assert cell.run(tmp_path).policies == first.policies
    assert policy.stat().st_mtime_ns == before
    policy.write_bytes(policy.read_bytes()[:100])
    failure = ran(cell, tmp_path)
    assert isinstance(failure, str)
    assert f"{policy}: damaged" in failure
    assert "remove it to train anew" in failure


def test_a_policy_that_follows_is_judged_at_every_command_and_every_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def trained(*given: Any, **arguments: Any) -> TrainResult:
        asked.append(arguments)
        return train(*given, **arguments, settings=small)

    full = learners.learner("ppo").settings(SCRATCH)
    small = dataclasses.replace(
        full, n_envs=2, algorithm=full.algorithm | {"n_steps": 64, "batch_size": 64}
    )
    monkeypatch.setattr(trials, "train", trained)
    trial = Following(
        "ppo",
        SCRATCH,
        128,
        (("", LAST),),
        speeds=(0.4, 0.6),
        control_period=0.02,
        commands=(0.45, 0.55),
        changes=(0.5, 0.4, 0.6),
    )
    found = Cell(Row("front", "front", FRONT, trial), 0, protocol=FEW).run(tmp_path)
    assert (asked[0]["speeds"], asked[0]["control_period"]) == ((0.4, 0.6), 0.02)
    assert list(found.policies) == [
        *("0.45 m/s", "0.55 m/s"),
        *("0.4 m/s after 0.5", "0.6 m/s after 0.4"),
    ]
    assert found.policies["0.45 m/s"].share == 0.0


def test_a_policy_trained_under_disturbances_is_judged_with_each_of_them_and_without(
    tmp_path: Path,
) -> None:
    trial = Disturbed(
        "ppo",
        SCRATCH,
        64,
        (("last", LAST),),
        disturbances={"actuator_delay": 1, "sensor_noise": {"leg_rate": 0.1}},
        task={"value_of_distance": 3.0},
        changes={"n_envs": 2, "n_steps": 32, "batch_size": 32},
    )
    cell = Cell(Row("rough", "rough", DISTURBED, trial), 0, protocol=FEW)
    found = cell.run(tmp_path)
    assert list(found.policies) == [
        *("last: undisturbed", "last: actuator delay", "last: sensor noise"),
        "last: all disturbances",
    ]
    record = read_record(tmp_path / "rough_0" / LAST)
    assert record["disturbances"]["actuator_delay"] == 1
    assert record["task"]["value_of_distance"] == 3.0
    other = dataclasses.replace(trial, task={"value_of_distance": 4.0})
    assert other.settings != trial.settings
    assert hash(cell.row) == hash(dataclasses.replace(cell.row))  # rows are keys of the tables


def test_a_page_is_filled_the_same_way_twice(tmp_path: Path) -> None:
    text = tmp_path / "learning.md"
    text.write_text(PAGE.read_text())
    sections = {LEARNED: "| a |\n| --- |", FIRST_EVENING: "| b |\n| --- |"}
    page.refresh(text, sections)
    once = text.read_text()
    page.refresh(text, {LEARNED: sections[LEARNED]})
    assert text.read_text() == once
    assert "| a |" in once
    assert "| b |" in once


def test_mistakes_on_the_command_line_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "other.md"
    other.write_text("# Another page\n")
    out = ["--out", str(tmp_path / "out")]
    for arguments, told in (
        (["--docs", str(other)], "<!-- study: learned -->"),
        (["--docs", str(PAGE), "--quick"], "leave out --quick"),
        (["--rows", "no_such_row"], "no_such_row"),
        (["--seeds", "0"], "at least 1"),
    ):
        with pytest.raises(SystemExit):
            command.main([*out, *arguments])
        (line,) = capsys.readouterr().err.splitlines()
        assert told in line
    assert other.read_text() == "# Another page\n"


def test_an_interrupted_command_says_that_the_same_one_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--out", str(tmp_path), "--seeds", "2", "--workers", "1", "--rows", "toy"]
    monkeypatch.setattr(command, "ROWS", (toy(stops_at=4),))
    assert command.main(arguments) == 130
    assert "the same command goes on" in capsys.readouterr().err
    monkeypatch.setattr(command, "ROWS", (toy("toy", FIRST_EVENING),))
    assert command.main(arguments) == 0
    assert "| a toy | best | 2 of 2 |" in capsys.readouterr().out
    assert (tmp_path / "toy_0" / "counted").read_text() == 10 * "0"
