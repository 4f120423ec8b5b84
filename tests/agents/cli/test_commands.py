"""What the commands do, on small tasks."""

from __future__ import annotations

import dataclasses
import json
import re
import sys
from contextlib import suppress
from functools import cache, partial
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from agents.cli.evaluate import COLUMNS, over_seeds
from agents.cli.main import REFUSED, main
from agents.evaluate import Protocol, evaluate
from agents.training import train
from agents.training_config import TrainingConfig
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.presets import BUILDABLE
from trajopt import Solution, periodic_gait
from trajopt.feedback.adaptive import AdaptiveController
from trajopt.feedback.controller import NEAR
from trajopt.feedback.gait_table import GaitTable, flat
from trajopt.feedback.laws import lqr
from trajopt.gaits.library import nearest
from trajopt.store import Store


@pytest.fixture
def shipped() -> Solution:
    return nearest(BUILDABLE, 0.55, 1)[0].load()


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch, shipped: Solution) -> Solution:
    """The gait that every search finds."""
    monkeypatch.setattr("trajopt.periodic_gait", lambda *what, **settings: shipped)
    return shipped


def test_a_gait_is_saved_and_reported_and_json_has_its_figures(
    solved: Solution, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "gaits" / "gait.npz"
    assert main(["gait", "--speed", "0.56", "--hold", "0.01", "--out", str(out)]) == 0
    report = capsys.readouterr().out
    assert f"{solved.cot:.6f}" in report
    assert "requested speed         0.56 m/s" in report
    assert Solution.load(out).cot == solved.cot
    assert main(["gait", "--speed", f"{solved.speed}", "--guess", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["cot"] == solved.cot


def test_a_full_disk_loses_no_report_and_a_closed_pipe_no_gait(
    solved: Solution,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def closed(gait: Solution) -> str:
        raise BrokenPipeError

    def full(gait: Solution, path: Path) -> None:
        raise OSError(28, "No space left on device", str(path))

    out = tmp_path / "gait.npz"
    with monkeypatch.context() as patch:
        patch.setattr(Solution, "report", closed)
        with suppress(SystemExit):
            main(["gait", "--out", str(out)])
    capsys.readouterr()
    assert Solution.load(out).cot == solved.cot
    monkeypatch.setattr(Solution, "save", full)
    assert main(["gait", "--out", str(out)]) == REFUSED
    printed = capsys.readouterr()
    assert f"{solved.cot:.6f}" in printed.out
    assert printed.err == f"error: {out}: No space left on device\n"


@pytest.fixture
def brief(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two starts of 0.4 s."""
    protocol = Protocol(starts=2, seed=0, duration=0.4, window=0.2, alive=0.1)
    short = partial(evaluate, protocol=protocol)
    monkeypatch.setattr(
        "agents.evaluate.evaluate", lambda *a, **k: short(*a, **k | {"progress": False})
    )


@pytest.mark.usefixtures("brief")
def test_policies_are_measured_in_one_table(capsys: pytest.CaptureFixture[str]) -> None:
    names = ["evolution", "imitation"]
    arguments = ["evaluate", *names, "--no-gap"]
    assert main([*arguments, "--json", "--disturbances", "actuator_delay=1"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert list(report["policies"]) == names
    assert report["disturbances"]["actuator_delay"] == 1
    assert main([*arguments, "--seeds"]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = [*names, "interquartile mean", "95 % from", "to"]
    assert [line[:24].strip() for line in lines[1:6]] == rows
    assert lines[6] == "0 of 2 walk, from at least 95% of their starts"
    assert any("of 2 starts do not count (" in line for line in lines[6:])


def test_costs_over_seeds_are_those_of_the_seeds_that_walk() -> None:
    figures = dict.fromkeys(column for column, _ in COLUMNS)
    rows = [
        figures | {"walking_share": share, "cot": cot, "return_20_s": back}
        for share, cot, back in (
            (1.0, 0.05, 5.0),
            (0.97, 0.06, 4.0),
            (0.5, 9.0, 3.0),
            (0.0, None, 0.0),
        )
    ]
    summary = over_seeds(rows)
    assert (summary["cot"]["mean"], summary["cot"]["seeds"]) == (pytest.approx(0.055), 2)
    assert (summary["return_20_s"]["mean"], summary["return_20_s"]["seeds"]) == (3.5, 4)


@pytest.mark.usefixtures("brief")
def test_a_policy_that_is_commanded_a_speed_is_measured_at_several(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    config = TrainingConfig("ppo", timesteps=0, speeds=(0.4, 0.6))
    policy = str(train(config, tmp_path, progress=False).last)
    arguments = ["evaluate", policy, "--no-gap", "--json"]
    assert main([*arguments, "--commands", "0.45", "0.55"]) == 0
    report = json.loads(capsys.readouterr().out)["policies"]
    assert list(report) == [f"{policy} at 0.45 m/s", f"{policy} at 0.55 m/s"]
    assert main([*arguments, "--seeds"]) == REFUSED
    assert "not summarised" in capsys.readouterr().err


def test_a_commanded_speed_that_is_not_kept_is_named_and_the_walk_has_a_gap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = str(train(TrainingConfig("ppo", timesteps=0, speeds=(0.3, 0.6)), tmp_path).last)
    brief = Protocol(starts=2, seed=0, duration=0.4, window=0.2, alive=0.1)
    stands = evaluate(lambda states, seen: np.zeros(len(seen)), protocol=brief)
    walks = dataclasses.replace(stands, walking_share=1.0, speed=0.52, cot=0.5)
    monkeypatch.setattr("agents.evaluate.evaluate", lambda *what, **settings: walks)
    arguments = ["evaluate", policy, "--commands", "0.35", "0.525", "0.54"]
    for table in ([], ["--headline"]):
        assert main([*arguments, *table]) == 0
        lines = capsys.readouterr().out.splitlines()
        flags = [line for line in lines if "the command is not kept" in line]
        walks_at = "walks at 0.520 m/s, over 2% off; the command is not kept"
        assert flags == [f"{policy} at {command} m/s: {walks_at}" for command in (0.35, 0.54)]
    assert main([*arguments, "--json"]) == 0
    for row in json.loads(capsys.readouterr().out)["policies"].values():
        assert 7.0 < row["gap"] < row["over_least"] < 12.0
        assert abs(row["return_share"]) < 0.1


@pytest.mark.usefixtures("brief")
def test_a_function_and_a_model_of_ones_own_have_rows_of_the_headline(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.py").write_text(
        "import numpy as np\n\n\n"
        "class Model:\n"
        "    def predict(self, observation, deterministic=False):\n"
        "        return np.full((len(observation), 1), 0.5 * deterministic), None\n\n\n"
        "model, number = Model(), 3\n\n\n"
        "def lean(observations):\n"
        "    return np.full(len(observations), 0.5)\n"
    )
    monkeypatch.chdir(tmp_path)
    names = ["mine:model", "mine:lean", "imitation"]
    assert main(["evaluate", *names, "--no-gap", "--headline"]) == 0
    head, _, *rows = (line.split(" | ") for line in capsys.readouterr().out.splitlines())
    assert [row[0] for row in rows] == [f"| {name}" for name in names]
    assert rows[0][1:] == rows[1][1:]
    assert rows[2][head.index("prior used")] == "law's actions"
    for name, message in (("mine:number", "of type int"), ("mine:nothing", "module:function")):
        assert main(["evaluate", name]) == REFUSED
        assert message in capsys.readouterr().err


def test_datasets_that_are_missing_are_written_by_one_process(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = ["--episodes", "2", "--out", str(tmp_path)]
    assert main(["data", "idle", *few]) == 0
    card = tmp_path / "rimless-wheel" / "idle-v0" / "README.md"
    before = card.stat().st_mtime_ns
    assert main(["data", "idle", "random", *few]) == 0
    assert card.stat().st_mtime_ns == before
    assert (tmp_path / "rimless-wheel" / "random-v0" / "data" / "metadata.json").is_file()
    with Store(tmp_path):
        assert main(["data", "idle", *few]) == REFUSED
    assert f"another process is working in {tmp_path}" in capsys.readouterr().err


@cache
def held() -> Solution:
    return periodic_gait(BUILDABLE, 0.62, hold=CONTROL_PERIOD)


@pytest.fixture
def gait(monkeypatch: pytest.MonkeyPatch) -> Solution:
    """The held gait that every search finds."""
    found = held()
    monkeypatch.setattr("trajopt.periodic_gait", lambda *what, **settings: found)
    return found


def test_walks_are_written_as_a_video_and_as_a_gif(
    tmp_path: Path, gait: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    law = lqr.design(gait)
    table = GaitTable(gait, law, (), np.array([flat(law.data)]))
    adaptive = AdaptiveController(table, law, NEAR, gait)
    monkeypatch.setattr(AdaptiveController, "about", lambda wanted: adaptive)
    video, gif = tmp_path / "walk.mp4", tmp_path / "walk.gif"
    size = ["--size", "240", "160"]
    assert main(["watch", "optimum", "--seconds", "0.2", "--out", str(video), *size]) == 0
    frames = imageio_ffmpeg.read_frames(str(video))
    about = next(frames)
    assert (about["fps"], about["duration"], len(list(frames))) == (50, 0.2, 10)
    names = ["evolution", "adaptive", "optimum"]
    assert main(["watch", *names, "--seconds", "0.3", "--out", str(gif), *size]) == 0
    with Image.open(gif) as picture:
        assert picture.size == (240, 160)
        assert (picture.n_frames, picture.info["duration"]) == (5, 60)  # type: ignore[attr-defined]
    assert sorted(tmp_path.iterdir()) == [gif, video]


def test_a_saved_gait_is_watched_but_not_on_another_machine(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], gait: Solution
) -> None:
    saved, out = tmp_path / "own.npz", tmp_path / "walk.gif"
    gait.save(saved)
    arguments = ["watch", str(saved), "--seconds", "0.2", "--size", "99", "99", "--out", str(out)]
    assert main(arguments) == 0
    assert out.is_file()
    assert main([*arguments, "--preset", "THESIS_PHYSICAL"]) == REFUSED
    assert "own.npz: is a gait of another machine" in capsys.readouterr().err


def test_what_is_missing_is_named_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    for word, remedy in (("watch", "--out walk.gif"), ("play", "rimless page")):
        assert main([word]) == REFUSED
        assert remedy in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert main(["watch", "nobody", "--out", str(tmp_path / "walk.mp4")]) == REFUSED
    assert "rimless-gym[video]" in capsys.readouterr().err


def test_a_page_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["page", "--out", str(tmp_path / "page.html")]) == 0
    assert "open it in any browser" in capsys.readouterr().out


@pytest.mark.slow
def test_warmup_compiles_every_part_and_prints_how_long_each_took(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["warmup"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines] == [
        *("environment", "vector environment", "evaluation", "reference simulator"),
    ]


def test_a_log_is_written_and_the_machine_identified_from_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    walk, machine = tmp_path / "walk.csv", tmp_path / "machine.json"
    changed = ["--params", "motor_constant=0.0222"]
    assert main(["log", "random", *changed, "--seconds", "2", "--out", str(walk)]) == 0
    assert "walk.csv: 200 samples, 1.99 s" in capsys.readouterr().out
    assert main(["identify", str(walk), "--out", str(machine)]) == 0
    assert re.search(r"motor_constant(.|\n)*machine\.json", capsys.readouterr().out)
    assert json.loads(machine.read_text())["motor_constant"] == pytest.approx(0.0222, rel=3e-3)
    assert main(["identify", str(walk), "--out", str(walk)]) == REFUSED
    assert "must end in .json" in capsys.readouterr().err
    assert walk.read_text().startswith("time,phi")
    assert main(["log", "random", "--out", str(tmp_path / "walk.xlsx")]) == REFUSED
    assert "must end in .csv or .npz" in capsys.readouterr().err
