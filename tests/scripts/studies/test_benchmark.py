"""The benchmark's machinery: workers, rounds, ratios and the page. No speed is asserted."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from scripts.studies.benchmarks import cartpole, environments
from scripts.studies.benchmarks.cases import CASES, OPTIMISATION, SINGLE, Case
from scripts.studies.benchmarks.driver import Worker, WorkerError, measure_all
from scripts.studies.benchmarks.environments import (
    OURS,
    REQUIREMENTS,
    UnavailableError,
    interpreter,
)
from scripts.studies.benchmarks.goals import GOALS
from scripts.studies.benchmarks.page import page
from scripts.studies.benchmarks.quote import BLOCK, ROWS, quote, quoted
from scripts.studies.benchmarks.results import by_key, ratio
from scripts.studies.benchmarks.walks import WINDOW, Walks, record_walks
from scripts.studies.benchmarks.workers.ours_lanes import PACKAGE, copied

ROOT = Path(__file__).parents[3]
DOCS = ROOT / "docs"
RATES = {"CartPole-v1": 200e3, "Acrobot-v1": 40e3, "InvertedDoublePendulum-v5": 20e3, "ours": 700e3}
RATES |= {"ours-vector-1024": 12e6, "ours-vector-16384": 13e6, "envpool-acrobot": 1e6}
RATES |= {"one-lane": 875e3, "one-lane-1024": 3e6, "one-lane-16384": 3.25e6}
#: Seconds to build and to solve Kelly's cart-pole.
SWING_UPS = {"ours": (0.02, 0.012), "bare": (0.03, 0.01), "dymos": (0.5, 40.0)}
SWING_UPS |= {"rockit-collocation": (0.4, 0.02), "rockit-shooting": (0.3, 0.05)}
SWING_UPS |= {"drake-ipopt": (0.003, 0.15), "drake-snopt": (0.003, 0.3)}
RATES |= {"cartpole-vector-1024": 16e6, "gymnax-acrobot-one": 5e6, "gymnax-acrobot-all": 6e6}


def made_up_run() -> dict[str, Any]:
    """A run in which the machine is half as fast in every second round."""
    results = []
    for case in CASES:
        answers = []
        for turn in range(min(3, case.most)):
            speed = RATES.get(case.key, 1e3) / (1 + turn % 2)
            answer = {"round": turn, "steps": 1000, "seconds": 1000 / speed, "replay_error": 1e-9}
            answer |= {"share": 0.02, "learning": 0.012, "logging": 0.003, "event_drift": 2e-12}
            answer |= {"idle": 10.0, "idle_cpu": 0.1}
            answer |= {"state_error": 3e-11, "event_error": 4e-15}
            if case.group == OPTIMISATION:
                times = SWING_UPS[case.key.removeprefix("swing-up-")]
                build, solve = (seconds * (1 + turn % 2) for seconds in times)
                answer |= {"build": build, "solve": solve, "total": build + solve}
                answer |= {"iterations": 13, "cost": 58.81}
            if case.key.startswith("memory"):
                answer |= {"envs": 100, "traced": 2048.0, "resident": 4096.0}
            answers.append(answer)
        about = {"version": f"{case.environment} 1.0", "starts": 9, "touchdown_share": 0.011}
        result = {name: getattr(case, name) for name in ("key", "group", "title", "physics")}
        result |= {"settings": case.settings, "one_core": case.one_core, "about": about}
        results.append(result | {"answers": answers, "error": None})
    machine = {"cpu": "Made Up", "cores": 2, "system": "None", "python": "3", "load": 0.0}
    run = {"rounds": 3, "seconds": 1.0, "date": "today", "git_revision": "abc", "results": results}
    return run | {"machine": machine, "versions": {"numba": "1", "numpy": "2"}}


def fail(run: dict[str, Any], key: str, error: str) -> None:
    result = next(result for result in run["results"] if result["key"] == key)
    result |= {"answers": [], "error": error, "about": {}}


def row(text: str, beginning: str) -> str:
    return next(line for line in text.splitlines() if line.startswith(f"| {beginning}"))


def test_ratios_are_within_rounds_so_that_a_slow_round_does_not_matter() -> None:
    found = by_key(made_up_run()["results"])
    found["CartPole-v1"]["answers"].pop()  # medians alone would now compare unlike rounds
    assert ratio(found["ours"], found["CartPole-v1"]) == pytest.approx(3.5)


def test_goals_are_measured_on_their_own_rows() -> None:
    found = by_key(made_up_run()["results"])
    measured = {goal.title: goal.measured(found) for goal in GOALS}
    assert None not in measured.values()
    assert measured["`gym.make`, over CartPole-v1"] == pytest.approx(3.5)
    assert measured["`gym.make`, over InvertedDoublePendulum-v5"] == pytest.approx(35)
    # gymnax with its faster setting, and each vector goal at its own size
    assert [measured[g.title] for g in GOALS[3:6]] == pytest.approx([12, 0.75, 13 / 6])
    # solving; building and solving, rockit and Drake with their faster settings; building in the
    # time of solving
    begin = next(i for i, goal in enumerate(GOALS) if "bare script" in goal.title)
    figures = [measured[goal.title] for goal in GOALS[begin : begin + 6]]
    assert figures == pytest.approx([1.2, 32 / 40, 350 / 32, 153 / 32, 40.5 / 0.032, 20 / 12])


def test_the_page_says_what_was_reached_and_what_was_missed() -> None:
    text = page(made_up_run())
    assert row(text, "`gym.make`, over CartPole-v1").endswith("| 3.5x | reached |")
    assert row(text, "vector, one thread, N = 1024").endswith("| 12x | **missed** |")
    assert row(text, "share of PPO's").endswith("| 2.0% | reached |")
    assert row(text, "the same with 256").endswith("| 2.0% | **missed** |")
    assert "other physics" in text
    assert row(text, "solving Kelly's cart-pole").endswith("| <= 1.3 times | 1.2 times | reached |")
    assert row(text, "building and solving it, over rockit").endswith("| >= 4x | 10.9x | reached |")


def test_the_share_of_a_training_is_shown_by_its_parts() -> None:
    assert "| 2.0% | 2.0% to 2.0% | 1.2% | 0.3% | 0.5% |" in row(page(made_up_run()), "8 envir")


def test_eight_lanes_are_compared_with_one_within_rounds() -> None:
    text = page(made_up_run())
    assert row(text, "one environment").endswith("| 700 k | 875 k | 0.8 |")
    assert row(text, "1024 environments").endswith("| 12 M | 3 M | 4 |")
    assert row(text, "16384 environments").endswith("| 13 M | 3.25 M | 4 |")


def test_times_are_compared_with_those_of_the_bare_script() -> None:
    text = page(made_up_run())
    bare = "| 30 ms | 10 ms | 10 ms to 20 ms | 13 | 58.81 | 1 | 1 | Hermite-Simpson; IPOPT"
    assert bare in row(text, "a bare script")
    # dymos has only one round, in which the bare script took 10 ms
    assert "| 500 ms | 40 s | 40 s to 40 s | 13 | 58.81 | 4e+03 |" in row(text, "dymos")


def test_the_row_of_a_peer_that_cannot_be_installed_says_so() -> None:
    run = made_up_run()
    fail(run, "envpool-acrobot", "cannot be installed here: no wheel")
    text = page(run)
    assert "cannot be installed here: no wheel" in row(text, "EnvPool Acrobot-v1")
    assert row(text, "vector, one thread, N = 1024").endswith("| - | not measured |")


@pytest.mark.parametrize("key", [case.key for case in CASES])
def test_the_page_can_be_written_without_any_one_row(key: str) -> None:
    run = made_up_run()
    fail(run, key, "went wrong")
    assert "went wrong" in page(run)
    run["results"] = [result for result in run["results"] if result["key"] != key]
    assert page(run)


def test_the_published_page_is_that_of_the_published_numbers() -> None:
    run = json.loads((DOCS / "benchmark.json").read_text())
    assert (DOCS / "benchmark.md").read_text() == page(run)
    assert {result["key"] for result in run["results"]} == {case.key for case in CASES}


def test_the_readme_quotes_the_published_numbers() -> None:
    run, readme = (
        json.loads((DOCS / "benchmark.json").read_text()),
        (ROOT / "README.md").read_text(),
    )
    assert len(BLOCK.findall(readme)) == 1
    assert quote(run) in readme
    assert quoted(readme, run) == readme


def test_the_quoted_ratios_are_taken_within_rounds() -> None:
    run = made_up_run()
    text = quote(run)
    assert row(text, "Gymnasium CartPole-v1").endswith("| 3.5 |")
    assert row(text, "EnvPool Acrobot-v1").endswith("| 12 |")
    assert "other physics" in text
    assert quoted("no block here", run) == "no block here"
    assert {key for ours, peers in ROWS.items() for key in (ours, *peers)} <= {
        case.key for case in CASES
    }
    fail(run, "ours", "went wrong")
    assert row(quote(run), "Gymnasium CartPole-v1").endswith("|  |")


WORKERS = ROOT / "rimless_gym" / "commands" / "benchmarks" / "workers"


def test_every_case_has_its_worker_and_its_pinned_requirements() -> None:
    assert len({case.key for case in CASES}) == len(CASES)
    for case in CASES:
        assert (WORKERS / f"{case.worker}.py").exists()
        if case.environment != OURS:
            lines = (REQUIREMENTS / f"{case.environment}.txt").read_text().split()
            assert lines
            assert all("==" in line for line in lines)


WORKER = """
from scripts.studies.benchmarks.protocol import serve
def setup(settings):
    print("not an answer")
    if settings.get("broken"):
        raise ValueError("no such thing")
    count = [0]
    def measure(seconds):
        count[0] += 1
        if seconds == 13:
            raise RuntimeError("unlucky")
        return {"steps": count[0], "seconds": seconds}
    return measure, {"version": "1"}
serve(setup)
"""


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Case:
    """A case whose worker counts its measurements."""
    (tmp_path / "fake.py").write_text(f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{WORKER}")
    monkeypatch.setattr("scripts.studies.benchmarks.driver.MODULES", "")
    monkeypatch.setattr("scripts.studies.benchmarks.driver.COMMANDS", tmp_path)
    return Case("fake", SINGLE, "fake", OURS, "fake")


def test_a_worker_warms_up_and_answers_once_for_each_question(fake: Case, tmp_path: Path) -> None:
    worker = Worker(fake, Path(sys.executable), tmp_path)
    try:
        assert worker.about == {"version": "1"}
        answers = [worker.measure(0.5), worker.measure(0.25)]
        assert [(a["steps"], a["seconds"]) for a in answers] == [(2, 0.5), (3, 0.25)]
        assert answers[1]["idle_cpu"] <= 0.5 * answers[1]["idle"] + 0.05
        with pytest.raises(WorkerError, match="unlucky"):
            worker.measure(13)
    finally:
        worker.close()
    with pytest.raises(ProcessLookupError):
        os.kill(worker.pid, 0)


def test_other_workers_go_on_after_one_has_failed(fake: Case, tmp_path: Path) -> None:
    broken = dataclasses.replace(fake, key="broken", settings={"broken": True})
    missing = dataclasses.replace(fake, key="missing", worker="nowhere")
    once = dataclasses.replace(fake, key="once", most=1)
    results = measure_all([broken, fake, missing, once], 3, 0.1, tmp_path, progress=False)
    assert results[0]["error"] == "ValueError: no such thing"
    assert "nowhere" in results[2]["error"]
    assert [[a["round"] for a in r["answers"]] for r in results] == [[], [0, 1, 2], [], [0]]


def test_ctrl_c_keeps_what_was_measured(
    fake: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    genuine, asked = Worker.measure, []

    def measure(self: Worker, seconds: float) -> dict[str, Any]:
        asked.append(seconds)
        if len(asked) == 3:
            raise KeyboardInterrupt
        return genuine(self, seconds)

    monkeypatch.setattr(Worker, "measure", measure)
    other = dataclasses.replace(fake, key="other")
    results = measure_all([fake, other], 5, 0.1, tmp_path, progress=False)
    assert [len(result["answers"]) for result in results] == [1, 1]


def test_other_rows_are_measured_where_a_peer_cannot_be_installed(
    fake: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def install(name: str, folder: Path, say: Any) -> Path:
        if name == "gone":
            raise UnavailableError("cannot be installed here: no wheel")
        return Path(sys.executable)

    monkeypatch.setattr("scripts.studies.benchmarks.driver.interpreter", install)
    gone = dataclasses.replace(fake, key="gone", environment="gone")
    results = measure_all([gone, fake], 2, 0.1, tmp_path, progress=False)
    assert results[0]["error"] == "cannot be installed here: no wheel"
    assert len(results[1]["answers"]) == 2


@pytest.mark.slow
def test_an_environment_that_cannot_be_made_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "odd.txt").write_text("not a requirement\n")
    monkeypatch.setattr(environments, "REQUIREMENTS", tmp_path)
    with pytest.raises(UnavailableError, match=r"cannot be installed here: .*requirement"):
        interpreter("odd", tmp_path / "venvs", print)


def test_the_cart_pole_gains_the_work_of_its_force() -> None:
    def energy(x: Any) -> Any:
        v, w = x[2], cartpole.LENGTH * x[3]
        kinetic = cartpole.CART * v**2 + cartpole.POLE * (v**2 + w**2 + 2 * v * w * np.cos(x[1]))
        return kinetic / 2 - cartpole.POLE * cartpole.GRAVITY * cartpole.LENGTH * np.cos(x[1])

    x, u, step = np.array([0.3, 0.7, -1.1, 2.3]), 4.0, 1e-5
    rates = np.array(cartpole.derivative(x, u, np.sin, np.cos))
    gained = (energy(x + step * rates) - energy(x - step * rates)) / (2 * step)
    assert gained == pytest.approx(u * x[2], rel=1e-8)


def test_repetitions_give_medians_and_refuse_another_optimum() -> None:
    solves = iter([0.2, 0.1, 0.3])
    figures = {"build": 1.0, "iterations": 13, "cost": cartpole.COST}

    def once() -> dict[str, float]:
        solve = next(solves)
        time.sleep(0.5 if solve == 0.3 else 0)
        return figures | {"solve": solve}

    answer = cartpole.repeated(once, 0.5)
    assert answer["steps"] == 3
    assert answer | figures | {"solve": 0.2, "total": 1.2} == answer
    with pytest.raises(RuntimeError, match="instead of"):
        cartpole.repeated(lambda: figures | {"solve": 0.1, "cost": 64.0}, 0.0)
    with pytest.raises(RuntimeError, match="instead of"):  # as workers do where a solver fails
        cartpole.repeated(lambda: figures | {"solve": 0.1, "cost": float("nan")}, 0.0)


@pytest.fixture(scope="module")
def walks() -> Walks:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("trajopt.feedback.catch.catch.COUNTS", (9, 24, 17, 41))  # a coarse plan
        return record_walks(walks=3, settling=0, recorded=WINDOW)


@pytest.mark.slow
def test_recorded_walks_touch_down_and_are_checked(walks: Walks) -> None:
    assert len(walks.starts) > 0
    assert 0.003 < walks.touchdowns < 0.03
    many = walks.take(7)
    assert many.actions.shape == (WINDOW, 7)
    assert np.array_equal(many.actions[:, 0], walks.actions[:, 0])
    assert many.check(many.ends) == 0
    with pytest.raises(RuntimeError, match="left the recorded walk"):
        many.check(many.ends + 1e-3)


def test_a_copy_of_the_package_has_the_lanes_asked_for_and_is_kept(tmp_path: Path) -> None:
    home = copied(PACKAGE, 4, tmp_path)
    lanes = (home / "rimless_gym" / "kernel" / "tile.py").read_text()
    assert lanes == (PACKAGE / "kernel" / "tile.py").read_text().replace("LANES = 8", "LANES = 4")
    made = home.stat().st_ino
    assert copied(PACKAGE, 4, tmp_path) == home
    assert home.stat().st_ino == made
    assert [path.name for path in tmp_path.iterdir()] == [home.name]


def test_a_package_whose_number_of_lanes_is_not_found_is_refused(tmp_path: Path) -> None:
    (tmp_path / "kernel").mkdir()
    (tmp_path / "kernel" / "tile.py").write_text("LANES = 16\n")
    with pytest.raises(RuntimeError, match="has 0 lines 'LANES = 8' to replace, not 1"):
        copied(tmp_path, 1, tmp_path / "copies")


@pytest.mark.slow
@pytest.mark.parametrize(
    "key",
    ["ours", "kernel", "ours-vector-1024", "one-lane", "accuracy", "import", "gait", "ppo-256"],
)
def test_our_workers_measure(key: str, tmp_path: Path) -> None:
    case = next(case for case in CASES if case.key == key)
    (result,) = measure_all([case], 1, 0.05, tmp_path, progress=False)
    assert result["error"] is None
    assert result["answers"][0]["steps"] > 0


def test_the_command_line_says_what_it_does() -> None:
    command = [sys.executable, str(ROOT / "scripts" / "benchmark.py"), "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd="/", env={})
    assert done.returncode == 0, done.stderr
    assert "default: 7" in done.stdout
