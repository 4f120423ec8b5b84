"""Command lines refuse mistakes with one line on stderr and status 2, before they begin to work."""

from __future__ import annotations

import errno
import importlib
import json
import os
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from agents.cli import evaluate as command
from agents.cli import solve_gait
from agents.cli.commandline import Parser, terminated_like_ctrl_c, whole
from agents.evaluate import evaluate
from agents.protocol import Protocol
from agents.train import train
from rimless_gym.presets import BUILDABLE, THESIS_PHYSICAL
from trajopt import Solution
from trajopt.gaits.fronts import shipped_front
from trajopt.gaits.library import nearest
from trajopt.processes import KilledError

#: The module of each command line, and what its work begins with, which must not be reached.
WORK = {
    "benchmark": ("scripts.studies.benchmark.run", "measure_all"),
    "compare": ("agents.cli.compare", "Comparison.run"),
    "evaluate": ("agents.cli.evaluate", "evaluate"),
    "figures": ("scripts.studies.documents.figures", "numbers"),
    "processors": ("scripts.studies.processors", "subprocess.run"),
    "publish": ("scripts.studies.publish", "shutil.copyfile"),
    "solve_gait": ("agents.cli.solve_gait", "periodic_gait"),
    "textbook": ("scripts.studies.textbook", "solve"),
    "thesis": ("scripts.studies.thesis.command", "experiments.campaign"),
    "train": ("agents.cli.train", "train"),
}


def test_help_says_a_default_as_it_is_typed_unless_there_is_none_or_it_is_said_already() -> None:
    parser = Parser("Nothing.")
    parser.add_argument("names", nargs="*", default=("a", "b"), help="who")
    parser.add_argument("--size", nargs=2, default=[720, 468], help="in pixels")
    parser.add_argument("--share", default="5%", help="of it")
    parser.add_argument("--machine", help="whose; by default a policy's own")
    parser.add_argument("--starts", default=24, help="by default some")
    parser.add_argument("--params", default={}, help="fields")
    parser.add_argument("--quick", action="store_true", help="less")
    told = parser.format_help()
    for typed in "who (default: a b)", "in pixels (default: 720 468)", "of it (default: 5%)":
        assert typed in told
    assert told.count("(default") == 3


def work(*arguments: Any, **settings: Any) -> None:
    pytest.fail("the work was begun")


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable:
    """Runs a command line in this process and returns the one line that it ends with."""

    def run(script: str, *arguments: object) -> str:
        module, begun = WORK[script]
        monkeypatch.setattr(f"{module}.{begun}", work)
        with pytest.raises(SystemExit) as ended:
            importlib.import_module(module).main([str(argument) for argument in arguments])
        told = capsys.readouterr()
        assert ended.value.code == 2
        assert told.out == ""
        assert told.err.startswith("error: ")
        assert told.err.count("\n") == 1
        return told.err

    return run


@pytest.fixture
def places(tmp_path: Path) -> dict[str, Path]:
    """Places where nothing can be written."""
    (tmp_path / "file").write_text("text")
    (tmp_path / "folder").mkdir()
    for name in ("search.npz", "results.json", "numbers.json", "benchmark.md"):
        (tmp_path / "taken" / name).mkdir(parents=True)
    return {
        "a file": tmp_path / "file",
        "below a file": tmp_path / "file" / "below",
        "no folder can be made": Path("/proc/nothing/here"),
        "a name that is too long": tmp_path / ("x" * 300),
        "no room for its part": tmp_path / ("x" * 252),
        "a folder": tmp_path / "folder",
        "its files are folders": tmp_path / "taken",
    }


@pytest.mark.parametrize(
    ("script", "place"),
    [
        (script, place)
        for script in ("benchmark", "compare", "figures", "thesis", "train")
        for place in ("a file", "below a file", "no folder can be made", "a name that is too long")
    ]
    + [(s, "its files are folders") for s in ("benchmark", "compare", "figures", "thesis")],
)
def test_folders_that_cannot_be_written_are_refused(
    refused: Callable, places: dict[str, Path], script: str, place: str
) -> None:
    assert str(places[place]) in refused(script, "--out", places[place])


@pytest.mark.parametrize(
    "place",
    [
        "a folder",
        "below a file",
        "no folder can be made",
        "a name that is too long",
        "no room for its part",
    ],
)
def test_files_that_cannot_be_written_are_refused(
    refused: Callable, places: dict[str, Path], place: str
) -> None:
    line = refused("solve_gait", "--out", places[place])
    assert str(places[place]) in line or str(places[place].parent) in line


def test_a_guess_is_read_from_its_file_and_a_closed_pipe_loses_no_gait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    guess, out, guesses = shipped_front(BUILDABLE).solutions[0], tmp_path / "out.npz", []

    def solved(*what: object, guess: Solution, **settings: object) -> Solution:
        guesses.append(guess)
        return guess

    def closed(gait: Solution) -> str:
        raise BrokenPipeError

    monkeypatch.setattr(solve_gait, "periodic_gait", solved)
    monkeypatch.setattr(Solution, "report", closed)
    guess.save(tmp_path / "guess.npz")
    with pytest.raises(BrokenPipeError):
        solve_gait.main(["--guess", str(tmp_path / "guess.npz"), "--out", str(out)])
    assert [found.cot for found in guesses] == [guess.cot]
    assert Solution.load(out).cot == guess.cot


def test_a_guess_that_is_no_gait_is_refused(refused: Callable, tmp_path: Path) -> None:
    (tmp_path / "guess.npz").write_text("none")
    assert "guess.npz: damaged" in refused("solve_gait", "--guess", tmp_path / "guess.npz")


def test_names_of_inputs_that_are_too_long_are_refused(refused: Callable) -> None:
    assert "File name too long" in refused("evaluate", "x" * 300)


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_folders_without_permission_are_refused(refused: Callable, tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    assert "Permission denied" in refused("thesis", "--out", tmp_path / "out")


@pytest.mark.parametrize(
    ("script", "arguments", "told"),
    [
        ("solve_gait", ["--workers", "0"], "--workers: '0': must be an integer of at least 1"),
        ("solve_gait", ["--workers", "1.5"], "'1.5': must be an integer"),
        ("solve_gait", ["--seed", "-1"], "--seed: '-1': must be an integer of at least 0"),
        ("solve_gait", ["--speed", "nan"], "--speed: 'nan': must be a number greater than 0"),
        ("solve_gait", ["--speed", "-1"], "must be a number greater than 0"),
        ("solve_gait", ["--steps", "0"], "must be an integer of at least 1"),
        ("solve_gait", ["--starts", "-1"], "must be an integer of at least 0"),
        ("solve_gait", ["--preset", "x"], "invalid choice"),
        ("solve_gait", ["--hold", "0"], "--hold: '0': must be a number greater than 0"),
        ("train", ["--seed", "-1"], "--seed: '-1': must be an integer of at least 0"),
        ("train", ["--timesteps", "many"], "at least 0"),
        ("train", ["--algo", "td3"], "invalid choice"),
        ("compare", ["--speed", "nan"], "must be a number greater than 0"),
        ("compare", ["--front", "0.5", "-1"], "must be a number greater than 0"),
        ("compare", ["--preset", "x"], "invalid choice"),
        ("compare", ["--steps", "0"], "at least 1"),
        ("compare", ["--params", '{"drug": 1}'], "'drug' is not a field of WheelParams: choose"),
        ("train", ["--params", '{"drag": -1}'], "--params: drag = -1.0: must be at least 0"),
        ("train", ["--params", '{"drag": "x"}'], "--params: drag = 'x': must be a real number"),
        ("train", ["--settings", '{"gama": 0.9}'], "'gama' is not known; choose from"),
        ("train", ["--algo", "evolution", "--settings", '{"x": 1}'], "'x' is not known"),
        ("train", ["--algo", "evolution", "--settings", '{"population": 2}'], "at least 4"),
        ("train", ["--algo", "evolution", "--settings", '{"race": "x"}'], "race = 'x'"),
        ("train", ["--settings", '{"gamma": NaN}'], "gamma = nan: must be finite"),
        ("train", ["--settings", '{"n_envs": 2.7}'], "n_envs = 2.7"),
        ("train", ["--settings", '{"init": 1}'], "'init' is not known"),
        ("train", ["--settings", '{"verbose": 1}'], "'verbose' is not known"),
        (
            "train",
            ["--settings", '{"n_envs": "x"}'],
            "n_envs = 'x': must be an integer of at least 1",
        ),
        (
            "train",
            ["--settings", '{"gamma": "x"}'],
            "--settings: gamma = 'x': must be a real number",
        ),
        ("train", ["--settings", '{"vec_env_wrapper": [3]}'], "3 is not known; list ['agents.sb3."),
        ("train", ["--task", '{"fall_penalty": -1}', "--speeds", "0.4", "0.5"], "fall_penalty"),
        ("evaluate", ["imitation", "--commands", "0.5"], "none of these policies is commanded"),
        ("train", ["--speeds", "0.5"], "--speeds: expected 2 arguments"),
        ("train", ["--speeds", "0.6", "0.4"], "must be in order, the least first"),
        ("train", ["--speeds", "0.6", "3"], "at most 2 m/s"),
        (
            "train",
            ["--speeds", "0.5", "0.5"],
            "(0.5, 0.5): the least must be below the greatest; for",
        ),
        ("train", ["--control-period", "0.015"], "must be a whole multiple of 0.01 s"),
        ("train", ["--task", '{"price": 1}'], "task: 'price' is not a field of Task: choose"),
        ("train", ["--task", '{"slip_penalty": -1}'], "slip_penalty = -1.0: must be at least 0"),
        ("solve_gait", ["--params", '{"n_legs": 2}'], "n_legs = 2: must be an integer"),
        ("solve_gait", ["--params", "PROTOTYPE"], "'PROTOTYPE': not JSON"),
        ("evaluate", ["--params", '{"drug": 1}', "imitation"], "'drug' is not a field"),
        ("evaluate", ["--preset", "PROTOTYPE", "imitation"], "trained on another machine"),
        ("evaluate", ["--gait", "none.npz", "lqr"], "none.npz"),
        ("evaluate", ["--speed", "0", "lqr"], "must be a number greater than 0"),
        ("evaluate", ["--speed", "50", "lqr"], "must be at most"),
        ("thesis", ["--workers", "0"], "at least 1"),
        ("thesis", ["--experiment", "7"], "invalid choice"),
        ("thesis", ["--experiment", "1", "--prototype"], "not allowed with"),
        ("multi_start", ["--workers", "0"], "at least 1"),
        ("multi_start", ["--seed", "-3"], "at least 0"),
        ("multi_start", ["--starts", "0"], "at least 1"),
        ("multi_start", ["--elements", "x"], "at least 1"),
        ("textbook", ["--elements", "0"], "at least 1"),
        ("textbook", ["--degree", "200"], "at most 40"),
        ("textbook", ["--tolerance", "nan"], "greater than 0"),
        ("textbook", ["nonsense"], "unknown problems: nonsense"),
        ("benchmark", ["--rounds", "0"], "at least 1"),
        ("benchmark", ["--seconds", "inf"], "greater than 0"),
        ("benchmark", ["--only", "x"], "invalid choice"),
        ("evaluate", ["none.zip"], "none.zip"),
        ("evaluate", ["--preset", "x", "none.zip"], "invalid choice"),
        ("processors", ["Z80"], "unknown processor Z80: choose from ['Haswell',"),
        ("train", ["--ranges", "{"], "--ranges: '{': not JSON"),
        ("train", ["--ranges", "[1]"], "'[1]': must be a JSON object"),
        ("train", ["--ranges", '{"n_legs": [4, 5]}'], "'n_legs' cannot be drawn: choose from"),
        ("train", ["--disturbances", '{"wind": 1}'], "'wind' is not a field of Disturbances"),
        ("train", ["--disturbances", '{"pushes": 3}'], "pushes = 3: give a rimless_gym.Pushes"),
        ("evaluate", ["--disturbances", "3", "x.zip"], "'3': must be a JSON object"),
        ("evaluate", ["--ranges", '{"gravity": [3, 2]}', "imitation"], "the least first"),
        ("evaluate", ["--ranges", '{"gravity": [-1, 2]}', "imitation"], "gravity"),
        ("publish", ["--study", "nowhere"], "run make compare"),
    ],
)
def test_invalid_options_are_refused_by_name(
    refused: Callable, script: str, arguments: list[str], told: str
) -> None:
    assert told in refused(script, *arguments)


def test_large_integers_may_be_written_as_powers_of_ten() -> None:
    assert [whole(1)(text) for text in ("20", "2e7")] == [20, 20_000_000]


@pytest.mark.parametrize(
    ("problem", "told"),
    [
        ("nothing:here", "No module named 'nothing'"),
        ("trajopt.ocp.textbook", "can be imported"),
        ("trajopt.ocp.textbook:none", "none"),
        ("trajopt.ocp.textbook:gear_ratio", "gives float, not a trajopt.Problem"),
    ],
)
def test_a_name_that_is_not_a_problem_is_refused(
    refused: Callable, tmp_path: Path, problem: str, told: str
) -> None:
    assert told in refused("multi_start", problem, "--out", tmp_path)


def test_a_damaged_search_is_refused(refused: Callable, tmp_path: Path) -> None:
    (tmp_path / "search.npz").write_text("no archive")
    assert "search again" in refused("multi_start", "--out", tmp_path)


def test_missing_or_damaged_numbers_are_refused(refused: Callable, tmp_path: Path) -> None:
    assert "leave out" in refused("figures", "--keep-numbers", "--out", tmp_path)
    for text in ("no JSON", "{}", "[]"):
        (tmp_path / "numbers.json").write_text(text)
        assert "damaged" in refused("figures", "--keep-numbers", "--out", tmp_path)


@pytest.mark.parametrize("heeded", [signal.default_int_handler, signal.SIG_IGN])
def test_sigterm_acts_like_ctrl_c_even_where_ctrl_c_is_ignored(heeded: Any) -> None:
    before = signal.signal(signal.SIGINT, heeded)
    try:
        with pytest.raises(KeyboardInterrupt), terminated_like_ctrl_c():
            os.kill(os.getpid(), signal.SIGTERM)
        assert signal.getsignal(signal.SIGINT) == heeded
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("kind", ["--prototype", "--experiment=1"])
def test_a_page_without_marks_is_refused_with_the_marks_that_it_needs(
    refused: Callable, tmp_path: Path, kind: str
) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Nothing to fill\n")
    line = refused("thesis", kind, "--out", tmp_path / "out", "--docs", page)
    assert "<!-- prototype -->" in line if kind == "--prototype" else "<!-- table -->" in line


@pytest.mark.parametrize("content", [None, b"\xff\xfe\xff", "folder"])
def test_a_page_that_is_missing_or_not_text_is_refused(
    refused: Callable, tmp_path: Path, content: Any
) -> None:
    page = tmp_path / "page.md"
    if content == "folder":
        page.mkdir()
    elif content is not None:
        page.write_bytes(content)
    assert "page.md" in refused("thesis", "--out", tmp_path / "out", "--docs", page)


def test_an_incomplete_study_is_refused(refused: Callable, tmp_path: Path) -> None:
    (tmp_path / "table.md").write_text("| table |\n")
    assert "cot_against_speed.png is missing" in refused("publish", "--study", tmp_path)


@pytest.fixture
def gait_file(tmp_path: Path) -> Path:
    nearest(THESIS_PHYSICAL, 0.5, 1)[0].load().save(tmp_path / "gait.npz")
    return tmp_path / "gait.npz"


def test_a_law_about_a_gait_of_another_machine_is_refused(
    refused: Callable, gait_file: Path
) -> None:
    line = refused("evaluate", "--preset", "PROTOTYPE", "--gait", gait_file, "lqr")
    assert "a gait of another machine" in line


@pytest.mark.slow
def test_a_law_is_measured_beside_policies(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], gait_file: Path
) -> None:
    monkeypatch.setattr("trajopt.feedback.startup.COUNTS", (7, 9, 8, 17))  # a coarse plan
    short = Protocol(starts=2, seed=0, duration=0.4, window=0.2, alive=0.1)
    brief = partial(evaluate, protocol=short)
    monkeypatch.setattr(command, "evaluate", lambda *a, **k: brief(*a, **k | {"progress": False}))
    arguments = ["lqr", "imitation", "--gait", str(gait_file), "--no-gap"]
    assert command.main([*arguments, "--json"]) == 0
    results = json.loads(capsys.readouterr().out)["policies"]
    assert list(results) == ["lqr", "imitation"]
    assert [row["gap"] for row in results.values()] == [None, None]
    assert command.main(arguments) == 0
    told = capsys.readouterr().out
    for name, row in results.items():
        counted = sum(row["faults"].values())
        assert (f"{name}: {counted} of 2 starts do not count (" in told) == (counted > 0)


def test_a_policy_that_is_commanded_a_speed_is_measured_at_several(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    policy = str(train("ppo", out=tmp_path, timesteps=0, speeds=(0.4, 0.6), progress=False).last)
    short = Protocol(starts=2, seed=0, duration=0.4, window=0.2, alive=0.1)
    brief = partial(evaluate, protocol=short)
    monkeypatch.setattr(command, "evaluate", lambda *a, **k: brief(*a, **k | {"progress": False}))
    arguments = [policy, "--no-gap", "--json"]
    assert command.main([*arguments, "--commands", "0.45", "0.55"]) == 0
    told = json.loads(capsys.readouterr().out)["policies"]
    assert list(told) == [f"{policy} at 0.45 m/s", f"{policy} at 0.55 m/s"]
    assert command.main(arguments) == 0
    told = json.loads(capsys.readouterr().out)["policies"]
    assert [name.rpartition(" at ")[2] for name in told] == [
        f"{speed:g} m/s" for speed in (n / 50 for n in range(20, 31))
    ]
    with pytest.raises(SystemExit):
        command.main([*arguments, "--seeds"])
    assert "not summarised" in capsys.readouterr().err


def test_a_gait_at_another_speed_than_asked_for_says_both(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    known = nearest(BUILDABLE, 0.55, 1)[0].load()
    monkeypatch.setattr("agents.cli.solve_gait.periodic_gait", lambda *what, **settings: known)
    for asked, told in (["--speed", "0.56", "--hold", "0.01"], True), (["--speed", "0.55"], False):
        assert solve_gait.main(asked) == 0
        report = capsys.readouterr().out
        assert f"{known.cot:.6f} at 0.5500 m/s" in report
        assert ("speed asked for         0.56 m/s; no speed nearer" in report) is told


def test_a_gait_for_which_the_disk_has_no_room_is_reported_all_the_same(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    known = nearest(BUILDABLE, 0.55, 1)[0].load()
    monkeypatch.setattr("agents.cli.solve_gait.periodic_gait", lambda *what, **settings: known)

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Solution, "save", full)
    with pytest.raises(SystemExit) as ended:
        solve_gait.main(["--speed", "0.55", "--out", str(tmp_path / "gait.npz")])
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert f"{known.cot:.6f} at 0.5500 m/s" in printed.out
    (line,) = printed.err.splitlines()
    assert "gait.npz: was not written (No space left on device); make room, or choose" in line


def test_a_killed_worker_is_told_of_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def run(comparison: Any) -> None:
        raise KilledError("evolution: its process was killed")

    monkeypatch.setattr("agents.cli.compare.Comparison.run", run)
    with pytest.raises(SystemExit) as ended:
        importlib.import_module("agents.cli.compare").main(["--out", str(tmp_path)])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "error: evolution: its process was killed; what was finished is kept" in line
    assert "the same command goes on" in line
