"""Every learner over several seeds: what is stored, what is printed, and how a seed is trained."""

import dataclasses
import functools
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from agents.evaluate import Protocol
from agents.learner import BEST, IMITATION
from agents.policy_files import load_policy
from agents.training_config import TrainingConfig
from rimless_gym.hybrid import CONTROL_PERIOD
from scripts.studies.learning import command, trials
from scripts.studies.learning.command import Compared, SeedTask, completed, finished, tables
from scripts.studies.learning.rows import ROWS, SECTIONS
from scripts.studies.learning.trials import (
    Following,
    Other,
    SeedResult,
    StudyRow,
    Trained,
    WalkFigures,
    walk_through,
)
from trajopt.store import Store

SIXTEEN = Protocol(starts=16)
BRIEF = Protocol(starts=4, seed=1, duration=1.0, window=0.5, alive=0.5)
NAN = math.nan


@dataclasses.dataclass(frozen=True)
class Toy:
    """A trial that trains nothing: its policies walk from the share that the seed says."""

    shares: tuple[float, ...]
    period: float = CONTROL_PERIOD
    needs: tuple[StudyRow, ...] = ()
    fails: int = -1

    def run(self, seed, folder, others, by):
        folder.mkdir()  # fails if it is run again
        if seed == self.fails:
            raise ValueError("it did not learn")
        assert all(other.exists() for other in others.values())
        share = self.shares[seed]
        policy = WalkFigures(share, 1.0 - share, 0.0, 0.05 + 0.01 * seed if share else NAN, 0.56)
        return SeedResult({"best kept": policy}, 1000 * (seed + 1), 1.5)


FIRST = StudyRow("first", "the first", "learned", Toy((1.0, 0.96, 0.5)))
SECOND = StudyRow("second", "the second", "learned", Toy((1.0, 1.0, 0.0), needs=(FIRST,), fails=2))


def tasks(*rows):
    return [SeedTask(row, seed) for row in rows for seed in range(3)]


@pytest.fixture
def store(tmp_path):
    with Store(tmp_path / "study") as store:
        yield store


def test_finished_seeds_are_kept_failures_are_told_and_needed_rows_come_first(store):
    failures = completed(store, tasks(SECOND, FIRST), BRIEF, 1)
    assert failures == {SeedTask(SECOND, 2): "ValueError: it did not learn"}
    results = finished(store, (FIRST, SECOND), 3)
    assert [result.steps for result in results[FIRST]] == [1000, 2000, 3000]
    assert SECOND not in results  # too few seeds
    assert finished(store, (SECOND,), 2)[SECOND][1].policies["best kept"].share == 1.0
    again = completed(store, tasks(FIRST), BRIEF, 1)  # none is run again
    assert again == {}


def test_a_row_without_the_policies_that_it_needs_says_so(store):
    failures = completed(store, [SeedTask(SECOND, 0)], BRIEF, 1)
    assert failures == {SeedTask(SECOND, 0): "needs a policy of first: run these rows first"}


def test_a_changed_trial_is_another_task():
    other = dataclasses.replace(FIRST, trial=Toy((1.0, 0.96, 0.6)))
    assert SeedTask(FIRST, 0).key == SeedTask(dataclasses.replace(FIRST), 0).key
    assert len({SeedTask(FIRST, 0).key, SeedTask(FIRST, 1).key, SeedTask(other, 0).key}) == 3


def test_tables_count_seeds_that_do_not_walk_and_average_over_the_others():
    results = {FIRST: [FIRST.trial.run(*seed) for seed in made_seeds()]}
    (table,) = tables(results, compared).values()
    (line,) = table.splitlines()[2:]
    assert line == (
        "| the first, best kept | 2 of 3 | 96 % (50 to 100) | +10.0 % (+10.0 to +10.0) | 0.0550 | "
        "0.560 | 18 % | 0 % | 80 % | 1.5 | 2 k |"
    )


def compared(row, policy):
    return Compared(0.1 if row.walks(policy) else None, 0.8)


def made_seeds():
    class Folder:
        def mkdir(self):
            pass

    return [(seed, Folder(), {}, BRIEF) for seed in range(3)]


def test_where_nothing_walks_figures_are_missing_and_all_commands_have_a_line():
    nothing = WalkFigures(0.0, 1.0, 0.0, NAN, NAN)
    row = StudyRow("plain", "plain", "first_evening", Trained("ppo"))
    results = {row: [SeedResult({"0.5 m/s": nothing, "0.6 m/s": nothing}, 500, 1.0)]}
    (table,) = tables(results, lambda row, policy: Compared()).values()
    assert table.splitlines()[2] == (
        "| plain | 0.5 m/s | 0 of 1 | 0 % (0 to 0) | - | - | - | 100 % | 0 % |"
    )
    assert table.splitlines()[4].startswith("| plain | all of these | 0 of 1 |")


def test_gaps_are_of_policies_that_walk_and_act_as_often_as_the_optimum(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "gap_to_optimum", lambda params, cot, speed, *_, **__: cot)
    walks, falls = (WalkFigures(share, 1 - share, 0.0, 0.05, 0.56, 4.5) for share in (1.0, 0.5))
    front = dataclasses.replace(FIRST, table="front")
    assert command.compared_in(tmp_path, front, walks) == Compared(0.05)
    assert command.compared_in(tmp_path, front, falls) == Compared()
    other = StudyRow("other", "other", "learned", Toy((1.0,), period=0.04))
    assert command.compared_in(tmp_path, other, walks) == Compared()


def test_without_a_command_a_policy_is_compared_with_the_best_gait_at_any_speed(
    tmp_path, monkeypatch
):
    gait = SimpleNamespace(cot=0.04, speed=0.5)
    monkeypatch.setattr(command, "best_gait", lambda folder: gait)
    walks, falls = (WalkFigures(share, 1 - share, 0.0, 0.05, 0.56, 2.3) for share in (1.0, 0.5))
    share = 2.3 / (20.0 * 0.5 * (0.5 - 0.04))  # of the gait's return, 0.5 being the reward's weight
    assert command.compared_in(tmp_path, FIRST, walks) == pytest.approx((0.25, share))
    assert command.compared_in(tmp_path, FIRST, falls) == (None, pytest.approx(share))


def test_the_command_replaces_the_lines_of_finished_rows(tmp_path, monkeypatch, capsys):
    page, out = tmp_path / "page.md", tmp_path / "out"
    known = "| policy | seeds that walk |\n| the first, best kept | old |\n| another | stays |\n"
    page.write_text(f"<!-- study: learned -->\n{known}<!-- end of learned -->\n")
    monkeypatch.setattr(command, "ROWS", (FIRST, SECOND))
    monkeypatch.setattr(command, "compared_in", lambda *_: Compared())
    study = functools.partial(command.learning, out=out, seeds=2, workers=1, docs=page)
    assert study(rows=("first",)) == 0
    assert "| the first, best kept | 2 of 2 |" in page.read_text()
    assert "old" not in page.read_text()
    assert "| another | stays |" in page.read_text()
    assert study() == 0
    assert "| the second, best kept | 2 of 2 |" in page.read_text()
    assert "the second" in capsys.readouterr().out
    with pytest.raises(ValueError, match="needs --docs"):
        command.learning(headline=page)


def test_the_rows_have_names_and_titles_of_their_own_and_a_table():
    assert len({row.name for row in ROWS}) == len({row.title for row in ROWS}) == len(ROWS)
    assert {row.table for row in ROWS} == set(SECTIONS)
    keys = {SeedTask(row, 0).key for row in ROWS}
    assert len(keys) == len(ROWS)
    for row in ROWS:
        assert all(other in ROWS for other in row.trial.needs)


@pytest.fixture(scope="module")
def untrained(tmp_path_factory):
    """A store with a policy that has learned nothing, and its row."""
    row = StudyRow("untrained", "untrained", "learned", Trained("ppo", timesteps=0))
    with pytest.MonkeyPatch.context() as patch, Store(tmp_path_factory.mktemp("study")) as store:
        patch.setattr(trials, "TrainingConfig", functools.partial(TrainingConfig, protocol=BRIEF))
        assert completed(store, [SeedTask(row, 0)], BRIEF, 1) == {}
        yield store, row


def test_a_training_continues_from_a_policy_of_another_row_of_the_same_seed(untrained):
    store, row = untrained
    small = {"n_envs": 2, "n_steps": 32, "batch_size": 32}
    trial = Trained("ppo", IMITATION, 64, start=Other(row, BEST), hyperparameters=small)
    tuned = StudyRow("tuned", "tuned", "learned", trial)
    assert completed(store, [SeedTask(tuned, 0)], BRIEF, 1) == {}
    [result] = finished(store, [tuned], 1)[tuned]
    assert result.steps == 64
    assert result.minutes > 0.0
    started, trained = (load_policy(store.folder / SeedTask(r, 0).key / BEST) for r in (row, tuned))
    assert started.record["policy_kwargs"] == trained.record["policy_kwargs"]


def test_cma_es_leaves_a_policy_as_it_is_that_does_not_walk(untrained):
    store, row = untrained
    trial = Trained("cma_es", IMITATION, start=Other(row, BEST))
    tuned = StudyRow("left", "left", "learned", trial)
    assert completed(store, [SeedTask(tuned, 0)], BRIEF, 1) == {}
    [first], [result] = finished(store, [row, tuned], 1).values()
    assert repr(result.policies) == repr(first.policies)  # some figures may be NaN
    assert result.steps == 0


def test_policies_for_commanded_speeds_are_evaluated_at_each_and_as_they_change(monkeypatch):
    trial = Following("ppo", commands=(0.52, 0.6), changes=(0.6, 0.52))
    monkeypatch.setattr(trials, "load_policy", lambda *_: load_policy("front"))
    policies = trial.evaluate({"": Path()}, BRIEF)
    assert list(policies) == ["0.52 m/s", "0.6 m/s", "0.52 m/s after 0.6"]


def leaning(states, seen):
    """Lean further forward, the faster it should go; both are steady voltages that roll on."""
    return np.where(seen[:, 6] > 0.5, 0.7, 0.6)


def test_a_walk_goes_on_while_the_command_changes():
    seen_commands = []

    def looking(states, seen):
        seen_commands.append(seen[0, 6])
        return leaning(states, seen)

    (_, fast), (_, slow) = walk_through(looking, (0.6, 0.35), SIXTEEN, seconds=8.0)
    each = round(8.0 / 0.04)
    assert np.allclose(seen_commands, [0.75] * (2 * each + 1) + [-0.5] * (each - 1))
    assert fast.speed > slow.speed > 0.5
    assert fast.share >= slow.share > 0.2
    assert 0.0 < fast.falls <= slow.falls < 0.8


def test_all_commands_have_figures_where_all_walks_fall():
    def toppling(states, seen):
        return np.where(np.arange(len(seen)) % 2, -1.0, 1.0) * np.sign(seen[:, 1] + 0.3)

    stretches = walk_through(toppling, (0.5, 0.6, 0.4), SIXTEEN, seconds=2.0)
    assert [command for command, _ in stretches] == [0.5, 0.6, 0.4]
    assert [figures.falls for _, figures in stretches] == [1.0] * 3
    assert all(np.isnan(figures.cot) for _, figures in stretches)
