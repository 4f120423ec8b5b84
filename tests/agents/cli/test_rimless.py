"""The command `rimless`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import imageio_ffmpeg
import pytest
from PIL import Image

from agents.cli import command as rimless
from agents.cli import play, warmup, watch
from agents.policy_files import PRETRAINED
from rimless_gym.checks import MissingExtraError
from rimless_gym.presets import BUILDABLE
from scripts.studies import publish_policy
from trajopt import Solution, periodic_gait
from trajopt.gaits.library import nearest

#: Files that run a command in a checkout.
SCRIPTS = Path(rimless.__file__).parents[1] / "scripts"

#: Makes an interpreter in which a package cannot be imported.
WITHOUT = "import sys; sys.modules[{name!r}] = None; "


@pytest.mark.parametrize("word", rimless.COMMANDS)
def test_every_word_is_a_command_with_a_help(word: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert callable(import_module(f"agents.cli.{rimless.COMMANDS[word].module}").main)
    with pytest.raises(SystemExit) as end:
        rimless.main([word, "--help"])
    assert end.value.code == 0
    assert f"rimless {word}" in capsys.readouterr().out


def test_without_a_word_all_commands_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert rimless.main([]) == 0
    told = capsys.readouterr().out
    assert all(f"  {word} " in told for word in rimless.COMMANDS)


def unread(code: str, write: int) -> tuple[int, bytes]:
    """Status and stderr of code that writes into a pipe that nobody reads."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    done = subprocess.run(
        [sys.executable, "-c", code], stdout=write, stderr=subprocess.PIPE, env=environment
    )
    os.close(write)
    return done.returncode, done.stderr


@pytest.mark.parametrize("arguments", [["--help"], ["watch", "--help"]])
def test_it_ends_without_a_word_if_nobody_reads_what_it_prints(arguments: list[str]) -> None:
    read, write = os.pipe()
    os.close(read)
    code = f"import sys; from agents.cli.command import main; sys.exit(main({arguments}))"
    assert unread(code, write) == (rimless.UNREAD, b"")


def test_what_fails_while_nobody_reads_is_told_all_the_same() -> None:
    read, write = os.pipe()
    os.close(read)
    code = (
        "from agents.cli.command import unread_quietly\n"
        "with unread_quietly():\n    print(1)\n    raise RuntimeError('broken')"
    )
    status, told = unread(code, write)
    assert status not in (0, rimless.UNREAD)
    assert b"RuntimeError: broken" in told


def test_an_unknown_word_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert rimless.main(["dance"]) == 2
    assert "'dance' is no command: watch, play" in capsys.readouterr().err


#: Asks every command for its help, and prints its exit status and what it said.
ASKING = """
import contextlib, io, json
from agents.cli.command import COMMANDS, main
found = {}
for word in COMMANDS:
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            status = main([word, "--help"])
        except SystemExit as end:
            status = end.code
    found[word] = status, said.getvalue()
print(json.dumps(found))
"""


def test_what_needs_an_extra_says_so_and_the_rest_works() -> None:
    code = WITHOUT.format(name="torch") + WITHOUT.format(name="stable_baselines3") + ASKING
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    needing = {word for word, (_, said) in found.items() if "'rimless-gym[learn]'" in said}
    assert "train" in needing
    assert not needing & {"watch", "play", "gait", "evaluate", "warmup"}
    for word, (status, said) in found.items():
        assert status == (2 if word in needing else 0), (word, said)


def test_data_says_which_extra_brings_minari() -> None:
    code = (
        WITHOUT.format(name="minari") + "from agents.cli.command import main; main(['data', '-h'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "minari is not installed: it comes with pip install 'rimless-gym[data]'" in done.stderr


def test_a_missing_extra_ends_a_script_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(name: str) -> None:
        raise MissingExtraError("torch is not installed")

    monkeypatch.setattr(rimless, "import_module", missing)
    assert rimless.run("train") == 2
    assert capsys.readouterr().err == "error: torch is not installed\n"


@pytest.fixture
def gait(monkeypatch: pytest.MonkeyPatch) -> None:
    """The gait is solved once."""
    monkeypatch.setattr(watch, "periodic_gait", _solved)


@cache
def _solved(*what: object, **settings: object) -> Solution:
    return periodic_gait(*what, **settings)  # type: ignore[arg-type]


@pytest.mark.usefixtures("gait")
def test_a_walk_is_written_as_a_video(tmp_path: Path) -> None:
    out = tmp_path / "walk.mp4"
    assert watch.main(["optimum", "--seconds", "0.5", "--out", str(out)]) == 0
    frames = imageio_ffmpeg.read_frames(str(out))
    told = next(frames)
    assert (told["fps"], told["duration"]) == (50, 0.5)
    assert len(list(frames)) == 25
    assert [path.name for path in tmp_path.iterdir()] == ["walk.mp4"]


def test_a_video_without_ffmpeg_is_refused_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match=r"rimless-gym\[video\]"):
        watch.main(["nobody", "--out", str(tmp_path / "walk.mp4")])


@pytest.mark.usefixtures("gait")
def test_walkers_are_written_as_a_gif(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "walk.gif"
    arguments = ["evolution", "optimum", "--seconds", "0.6", "--size", "240", "160"]
    assert watch.main([*arguments, "--out", str(out)]) == 0
    with Image.open(out) as picture:
        assert picture.size == (240, 160)
        assert picture.n_frames == 10  # type: ignore[attr-defined]
        assert picture.info["duration"] == 60
    assert "gif: 100%" in capsys.readouterr().err


def test_a_saved_gait_is_watched_but_not_on_another_machine(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = tmp_path / "own.npz"
    nearest(BUILDABLE, 0.56, 1)[0].load().save(saved)
    arguments = ["--seconds", "0.3", "--size", "240", "160", "--out", str(tmp_path / "walk.gif")]
    assert watch.main([str(saved), *arguments]) == 0
    with Image.open(tmp_path / "walk.gif") as picture:
        assert picture.n_frames == 5  # type: ignore[attr-defined]
    with pytest.raises(SystemExit):
        watch.main([str(saved), "--preset", "THESIS_PHYSICAL", *arguments])
    assert "own.npz: is a gait of another machine" in capsys.readouterr().err


@pytest.mark.usefixtures("gait")
def test_a_window_shows_the_optimum_until_its_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watch, "require_display", lambda parser, remedy: None)
    shown = []
    monkeypatch.setattr("agents.cli.watch.Window.show", lambda window, frame: shown.append(frame))
    assert watch.main(["--seconds", "0.4", "--size", "240", "160"]) == 0
    assert [frame.shape for frame in shown] == 10 * [(160, 240, 3)]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--out", "walk.avi"], "ends with .gif or .mp4"),
        (["nobody", "--out", "walk.gif"], "nobody"),
        (["lqr", "lqr", "--out", "walk.gif"], "lqr: is named twice"),
        (["--size", "3", "3"], "--size"),
        (["--size", "100000", "100000"], "at most 4000"),
        (["--seconds", "0.01", "--out", "walk.gif"], "at least 0.06, one picture"),
        (["--seconds", "1e9", "--out", "walk.gif"], "at most 60"),
        (["--speed", "5", "--out", "walk.gif"], "--speed 5: must be on this machine's front"),
        (
            ["--preset", "THESIS_PHYSICAL", "--speed", "5", "--out", "walk.gif"],
            "`rimless gait --preset THESIS_PHYSICAL --speed 5` searches",
        ),
        (
            ["evolution", "imitation", "lqr", "ppo", "robust", "--out", "walk.gif"],
            "5 walkers: at most 4",
        ),
    ],
)
def test_what_cannot_be_watched_is_refused(
    arguments: list[str],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as end:
        watch.main(arguments)
    assert end.value.code == 2
    assert told in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_without_a_display_the_remedy_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    for command, remedy in ((watch, "--out walk.gif"), (play, "rimless page")):
        with pytest.raises(SystemExit):
            command.main([])
        (line,) = capsys.readouterr().err.splitlines()
        assert remedy in line


@pytest.mark.parametrize("name", ["imitation", "../x", "a b"])
def test_a_card_is_not_written_over_one_of_the_comparison(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        publish_policy.main([name, str(PRETRAINED["evolution"]), "a title"])
    assert "must be a plain name" in capsys.readouterr().err


def test_ctrl_c_ends_a_command_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def pressed(arguments: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(warmup, "main", pressed)
    assert rimless.main(["warmup"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


@pytest.mark.slow
def test_warmup_compiles_every_part_and_says_how_long_each_took(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert rimless.main(["warmup"]) == 0
    told = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in told] == list(warmup.PARTS)
    assert all(float(line.split()[-2]) >= 0.0 for line in told)
