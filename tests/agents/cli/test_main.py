"""The command `rimless`: its words, what it refuses, and how it ends."""

from __future__ import annotations

import dataclasses
import inspect
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest

from agents.cli import main as cli
from agents.cli.learn import compare, train
from agents.cli.main import COMMANDS, INTERRUPTED, REFUSED, UNREAD, main
from agents.cli.options import Preset, fields, joined_fields, whole
from agents.comparison.study import Study
from agents.experts import EXPERT
from rimless_gym.presets import PRESETS
from trajopt.gaits.periodic import USUAL_SPEED
from trajopt.pool import KilledError

#: What the work of a command begins with; it must not be reached with bad input.
WORK = (
    "agents.training.train",
    "agents.comparison.compare.compare",
    "agents.evaluate.evaluate",
    "agents.datasets.write",
)


@pytest.fixture
def refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """Runs a command line that must be refused, and returns the one line on stderr."""

    def work(*arguments: Any, **settings: Any) -> None:
        pytest.fail("the work was begun")

    def run(*arguments: object) -> str:
        for each in WORK:
            monkeypatch.setattr(each, work)
        monkeypatch.chdir(tmp_path)
        try:
            status = main([str(each) for each in arguments])
        except SystemExit as end:
            status = int(end.code or 0)
        printed = capsys.readouterr()
        assert (status, printed.out) == (REFUSED, "")
        assert printed.err.startswith("error: ")
        assert printed.err.count("\n") == 1
        return printed.err

    return run


def helped(word: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as end:
        main([word, "--help"])
    assert not end.value.code
    return capsys.readouterr().out


@pytest.mark.parametrize("word", COMMANDS)
def test_every_word_has_a_help_with_all_its_options(
    word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text, doc = helped(word, capsys), inspect.getdoc(COMMANDS[word]) or ""
    for name, option in inspect.signature(COMMANDS[word]).parameters.items():
        assert f"    {name}: " in doc, name
        if option.kind is option.KEYWORD_ONLY:
            assert f"--{name.strip('_').replace('_', '-')}" in text


def test_help_imports_nothing_that_takes_long() -> None:
    heavy = ["numpy", "gymnasium", "numba", "casadi", "scipy", "torch", "matplotlib", "joblib"]
    code = f"""
import sys
from agents.cli.main import COMMANDS, main
main([])
for word in COMMANDS:
    try:
        main([word, "--help"])
    except SystemExit:
        pass
print([name for name in {heavy} if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_words_and_version_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert (main([]), main(["--version"])) == (0, 0)
    printed = capsys.readouterr().out
    assert all(f"\n  {word} " in printed for word in COMMANDS)
    assert printed.splitlines()[-1].startswith("rimless-gym ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("trian", "'trian' is no command: did you mean 'train'?"),
        ("dance", "'dance' is no command: choose from train, evaluate"),
        ("--loud", "Unrecognized options: --loud"),
        ("train --sed 3", "--sed, 3; did you mean --seed?"),
        ("gait --workers 0", "--workers: '0': must be an integer of at least 1"),
        ("gait --cluster tcp://here:8786", "must be dask://HOST:PORT, ray://HOST:PORT or auto"),
        ("gait --preset x", "invalid choice 'x' for argument '--preset'. Expected one of"),
        ("gait --params PROTOTYPE", "'PROTOTYPE': must be a JSON object {...}, or key=value"),
        ("gait --guess none.npz", "none.npz: no such file"),
        ("gait --out .", ".: is a folder"),
        ("gait --out /proc/none/gait.npz", "/proc/none: No such file"),
        ("train --task distance_weight=abc", "distance_weight = 'abc': must be a real number"),
        ("train --disturbances pushes.rate=1", "lacks ['impulse']"),
        ("train --control-period 0.015", "must be a whole multiple of 0.01 s"),
        ("compare --front 0.5 -1", "--front: '-1': must be a number greater than 0"),
        ("evaluate", "name a policy or a feedback law"),
        ("evaluate imitation --gap --no-gap", "exclude each other"),
        ("evaluate imitation evolution imitation", "imitation: is the same policy as imitation"),
        ("evaluate imitation --commands 0.5", "none of these policies is commanded"),
        ("data nobody", "nobody: no such file, and no policy of that name"),
        ("watch --out walk.avi", "ends with .gif or .mp4"),
        ("watch lqr lqr --out walk.gif", "name each only once"),
        ("watch evolution imitation lqr front robust --out walk.gif", "5 names: at most 4"),
    ],
)
def test_bad_input_is_refused_in_one_line_before_the_work_begins(
    refused: Callable[..., str], arguments: str, message: str
) -> None:
    assert message in refused(*arguments.split())


def test_a_file_name_that_stdout_cannot_print_is_no_error() -> None:
    code = r"from agents.cli.main import run; run(lambda: print('\udcff walk.gif') or 0, [])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert done.stdout == b"\\udcff walk.gif\n"


def test_fields_are_json_or_key_and_value() -> None:
    pushes = {"pushes": {"rate": 0.5, "impulse": [0.1, 0.5]}, "actuator_delay": 1, "name": "a b"}
    words = ["pushes.rate=0.5", "pushes.impulse=[0.1,0.5]", "actuator_delay=1", "name=a b"]
    joined = joined_fields(["--disturbances", *words, "imitation", "--params", "n_legs=6"])
    assert joined == ["--disturbances", "\n".join(words), "imitation", "--params", "n_legs=6"]
    assert fields(joined[1]) == pushes
    assert fields('{"pushes": {"rate": 0.5}}') == {"pushes": {"rate": 0.5}}
    assert [whole(1)(text) for text in ("20", "2e7")] == [20, 20_000_000]


def test_defaults_are_those_of_the_functions_behind_the_commands() -> None:
    options = inspect.signature(compare).parameters
    for field in dataclasses.fields(Study):
        if field.name in options:
            assert options[field.name].default == getattr(Study(), field.name), field.name
    assert inspect.signature(train).parameters["expert"].default == EXPERT
    speeds = [inspect.signature(each).parameters.get("speed") for each in COMMANDS.values()]
    defaults = {each.default for each in speeds if each} - {None}
    assert defaults == {USUAL_SPEED}
    assert set(get_args(Preset)) == set(PRESETS)


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (KeyboardInterrupt(), INTERRUPTED, "interrupted"),
        (KeyboardInterrupt("42 steps are kept"), INTERRUPTED, "interrupted: 42 steps are kept"),
        (KilledError("memory ran out"), REFUSED, "error: memory ran out"),
        (OSError(28, "No space left", "best.zip"), REFUSED, "error: best.zip: No space left"),
    ],
)
def test_a_command_ends_in_one_line_with_its_status(
    error: BaseException, status: int, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def command() -> int:
        """Do something."""
        raise error

    assert cli.run(command, []) == status
    assert capsys.readouterr().err.strip() == message


def test_a_fault_of_the_program_is_not_hidden() -> None:
    def command() -> int:
        """Do something."""
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        cli.run(command, [])


@pytest.mark.parametrize("handler", [signal.default_int_handler, signal.SIG_IGN])
def test_sigterm_acts_like_ctrl_c_even_where_ctrl_c_is_ignored(handler: Any) -> None:
    def command() -> int:
        """Do something."""
        os.kill(os.getpid(), signal.SIGTERM)
        return 0

    before = signal.signal(signal.SIGINT, handler)
    try:
        assert cli.run(command, []) == INTERRUPTED
        assert signal.getsignal(signal.SIGINT) == handler
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("arguments", [["--help"], ["watch", "--help"]])
def test_it_ends_quietly_if_nobody_reads_what_it_prints(arguments: list[str]) -> None:
    read, write = os.pipe()
    os.close(read)
    code = f"import sys; from agents.cli.main import main; sys.exit(main({arguments}))"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, env=environment)
    os.close(write)
    assert (done.returncode, done.stderr) == (UNREAD, b"")


def test_a_command_names_the_extra_that_it_lacks() -> None:
    code = """
import sys

class Without:
    def find_spec(self, name, path=None, target=None):
        if name in ("torch", "stable_baselines3", "minari"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Without())
from agents.cli.main import main
print(main(["train", "--out", "/dev/null/x"]), main(["data", "idle", "--out", "/dev/null/x"]))
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == "2 2\n"
    learn, data = done.stderr.splitlines()
    assert "pip install 'rimless-gym[learn]'" in learn
    assert "pip install 'rimless-gym[data]'" in data
