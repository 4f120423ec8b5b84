"""A comparison: its settings, its tasks in processes, and what a kill costs."""

from __future__ import annotations

import dataclasses
import functools
import json
import signal
import time
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.comparison import compare as module
from agents.comparison import methods as listed
from agents.comparison import study as shared
from agents.comparison.compare import compare, complete, longest_chains_first
from agents.comparison.methods import methods
from agents.comparison.study import Setting, Study
from agents.evaluate import Protocol, evaluate, evaluate_commanded
from agents.training_config import TrainingConfig
from rimless_gym import BUILDABLE
from rimless_gym.hybrid import CONTROL_PERIOD
from tests.agents.runs import QUICK, SMALL
from trajopt.store import Store


@dataclasses.dataclass(frozen=True)
class Toy:
    """Adds one to the sum of the results that it needs."""

    name: str
    after: tuple[str, ...] = ()
    fails: bool = False

    def compute(self, setting: Setting) -> dict[str, Any]:
        if self.fails:
            raise ValueError(f"{self.name} went wrong")
        (setting.out / f"{self.name}.txt").write_text(self.name)
        needed = [Store(setting.out).load(name)["sum"] for name in self.after]
        return {"sum": 1 + sum(needed), "files": [f"{self.name}.txt"]}

    def rows(self, setting: Setting, result: dict[str, Any]) -> list[Any]:
        return []


TOYS = (Toy("d", ("b", "c")), Toy("a"), Toy("b", ("a",)), Toy("c", ("a",)), Toy("e"))
SUMS = {"d": 5, "a": 1, "b": 2, "c": 2, "e": 1}


def sums(out: Path, workers: int = 1, toys: tuple[Toy, ...] = TOYS) -> dict[str, int]:
    with Store(out) as store:
        complete(Setting(Study(), out), toys, store, workers)
        return {toy.name: store.load(toy.name)["sum"] for toy in toys}


def changed(**changes: bool) -> tuple[Toy, ...]:
    """The toys, the last one of which is changed."""
    return (dataclasses.replace(TOYS[0], **changes), *TOYS[1:])


@pytest.mark.parametrize("study", [Study(), Study(further=(), retrain=True)])
def test_all_methods_wait_only_for_others_that_are_begun_before_them(study: Study) -> None:
    order = longest_chains_first(methods(study))
    names = [method.name for method in order]
    assert len(set(names)) == len(names) == len(methods(study))
    for k, method in enumerate(order):
        assert set(method.after) <= set(names[:k])


def test_finished_results_are_not_computed_again_unless_their_files_changed(
    tmp_path: Path,
) -> None:
    assert sums(tmp_path) == SUMS
    assert sums(tmp_path, toys=tuple(dataclasses.replace(t, fails=True) for t in TOYS)) == SUMS
    (tmp_path / "d.txt").write_text("edited")
    with pytest.raises(ValueError, match="d went wrong"):
        sums(tmp_path, toys=changed(fails=True))
    assert sums(tmp_path) == SUMS
    assert (tmp_path / "d.txt").read_text() == "d"


def test_a_folder_of_another_study_or_a_file_is_refused(tmp_path: Path) -> None:
    with Store(tmp_path, {"study": {"seed": 1}}, record="study.json"):
        pass
    with pytest.raises(ValueError, match="study"):
        compare(Study(), tmp_path, progress=False)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"preset": "x"}, ValueError, "unknown preset 'x': choose from"),
        ({"front": (0.6, 0.5)}, ValueError, "front = .*least"),
        ({"further": (0.621,)}, ValueError, "stand for the same gait"),
    ],
)
def test_invalid_studies_are_refused_by_name(
    settings: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        Study(**settings)


def test_a_study_from_json_has_tuples_and_its_front_every_speed_of_a_law() -> None:
    assert Study(front=[0.5, 0.6], further=[0.5]) == Study(front=(0.5, 0.6), further=(0.5,))  # type: ignore[arg-type]
    study = Study(front=(0.55, 0.58), further=(0.5, 0.635))
    assert {study.on_tick(speed) for speed in study.speeds} <= set(study.front_speeds)
    ticks = [BUILDABLE.step_length / speed / CONTROL_PERIOD for speed in study.front_speeds]
    assert ticks == pytest.approx(range(round(ticks[0]), round(ticks[-1]) - 1, -1))


@pytest.mark.slow
def test_a_comparison_killed_at_random_moments_ends_with_the_same_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    brief = Protocol(starts=8, seed=1, duration=2.0, window=1.0, alive=1.0)
    train = listed.train

    def short(config: TrainingConfig, *arguments: Any, **settings: Any) -> Any:
        quick = dataclasses.replace(
            config,
            hyperparameters=SMALL.get(config.algo, {}),
            cloning=QUICK if config.init == "imitation" else None,
        )
        return train(quick, *arguments, **settings)

    def briefly(policy: Any, params: Any, protocol: Protocol, **more: Any) -> Any:
        return evaluate(policy, params, brief, **more)

    def commanded(*arguments: Any, **more: Any) -> Any:
        return evaluate_commanded(*arguments, protocol=brief, **more)

    def refuse(*arguments: Any) -> Any:
        raise ValueError("its table takes minutes")

    monkeypatch.setattr(listed.AdaptiveController, "about", refuse)
    monkeypatch.setattr(shared, "evaluate", briefly)
    monkeypatch.setattr(listed, "evaluate_commanded", commanded)
    monkeypatch.setattr(listed, "train", short)
    monkeypatch.setattr(module, "save_gif", lambda *arguments: None)
    monkeypatch.setattr(module, "ANIMATED", 0.1)
    few = {"timesteps": 512, "scratch_timesteps": 512, "evolution_timesteps": 0, "starts": 0}
    study = Study(**few, further=(), front=(0.55, 0.57), front_steps=(1,))

    def table(out: Path) -> list[Any]:
        rows = json.loads((out / "results.json").read_text())["table"]
        return [row | {"minutes": None} for row in rows]

    out, names = tmp_path / "killed", [method.name for method in methods(study)]
    rng = np.random.default_rng(0)
    for results in (0, 1, 3, 8, 11):  # killed soon after so many are there
        work = functools.partial(compare, study, out, progress=False, workers=1)
        process = get_context("fork").Process(target=work)
        process.start()
        while sum((out / f"{name}.json").exists() for name in names) < results:
            assert process.exitcode is None
            time.sleep(0.02)
        time.sleep(rng.uniform(0.0, 2.0))
        process.kill()
        process.join()
        assert process.exitcode == -signal.SIGKILL
    for folder in (out, tmp_path / "whole"):
        compare(study, folder, progress=False, workers=1)
    assert (out / "table.md").read_text() == (tmp_path / "whole" / "table.md").read_text()
    assert table(out) == table(tmp_path / "whole")
