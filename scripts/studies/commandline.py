"""The parser that all command lines share: it reports mistakes in one line, before any work.

parser = Parser(__doc__)
parser.add_argument("--workers", type=whole(1), default=1, help="processes")
parser.add_argument("--out", type=Path, default=Path("runs/x"), help="folder")
options = parser.parse_args(arguments)
parser.require_folder(options.out, "results.json")
with parser.refusing(): ...

A mistake ends the command with exit status 2.
"""

from __future__ import annotations

import argparse
import errno
import json
import os
import re
import signal
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn, TypeVar

from rimless_gym.checks import integer, positive
from rimless_gym.params import WheelParams
from rimless_gym.presets import PRESETS, preset
from trajopt.files import part_of
from trajopt.processes import KilledError

T = TypeVar("T")

#: The machine of the environment.
DEFAULT_PRESET = "BUILDABLE"

#: Help for options that the environment takes too.
PARAMS = """JSON: fields that differ from the preset's, '{"hub_damping": 0.01, "n_legs": 6}'"""
TASK = """JSON: the prices of the reward, '{"distance_weight": 0.8}'"""
RANGES = """JSON: parameters to draw for every episode, '{"pendulum_mass": [2.0, 2.4]}'"""
DISTURBANCES = (
    """JSON: '{"pushes": {"rate": 0.5, "impulse": [0.1, 0.5]}, "actuator_delay": 1, """
    """"sensor_noise": {"leg_rate": 0.1}}'"""
)


class Help(argparse.HelpFormatter):
    """Says an option's default as it would be typed, unless there is none or its help says it."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        text, default = action.help, action.default
        none = default is None or default is False or default in ("", [], (), {})
        if not text or none or default == argparse.SUPPRESS or "default" in text:
            return text
        words = default if isinstance(default, (list, tuple)) else [default]
        typed = " ".join(map(str, words)).replace("%", "%%")
        return f"{text} (default: {typed})"


class Parser(argparse.ArgumentParser):
    """A command line that reports mistakes in one line.

    Args:
        description: the module's docstring.
    """

    def __init__(self, description: str | None) -> None:
        super().__init__(description=description, formatter_class=Help)

    def error(self, message: str) -> NoReturn:
        """End with one line on stderr and status 2."""
        self.exit(2, f"error: {' '.join(message.split())}\n")

    def add_machine(self, default: str | None, meaning: str = "machine") -> None:
        """Options with which to choose a machine: a preset, and fields that differ from it."""
        self.add_argument("--preset", choices=sorted(PRESETS), default=default, help=meaning)
        self.add_argument("--params", type=json_object(dict), default={}, help=PARAMS)

    def add_trust(self) -> None:
        """The option that lets pickles be read."""
        self.add_argument(
            "--trust-pickle",
            action="store_true",
            help="also read files of plain stable-baselines3, which runs any code their author put "
            "in",
        )

    def machine(self, options: argparse.Namespace) -> WheelParams:
        """The machine that the options of `add_machine` chose; without a preset, the default's."""
        try:
            return preset(options.preset or DEFAULT_PRESET).replace(**options.params)
        except (TypeError, ValueError) as error:
            self.error(f"--params: {error}")

    @contextmanager
    def refusing(self) -> Iterator[None]:
        """Report a ValueError or OSError in the block as a command-line mistake."""
        try:
            yield
        except OSError as error:
            self.error(f"{error.filename}: {error.strerror}" if error.filename else str(error))
        except ValueError as error:
            self.error(str(error))

    @contextmanager
    def out_of_room(self, folder: Path) -> Iterator[None]:
        """Report what the computer lacks in one line with a remedy.

        That is room on a disk, a folder that can be written, or the memory that a worker needs.
        """
        try:
            yield
        except KilledError as error:
            self.error(
                f"{error}; what was finished is kept in {folder}, and the same command goes on"
            )
        except OSError as error:
            if error.errno in (None, errno.ENOENT, errno.ENAMETOOLONG):
                raise
            self.error(
                f"{error.filename or folder}: {error.strerror or error}: make room, or choose "
                "another --out; what was saved before is kept, and the same command goes on"
            )

    @contextmanager
    def writing(self, path: Path) -> Iterator[None]:
        """Report in one line, with a remedy, that a file cannot be written after all."""
        try:
            yield
        except OSError as error:
            self.error(
                f"{path}: was not written ({_reason(error)}); make room, or choose another --out"
            )

    def require_folder(self, folder: Path, *names: str) -> None:
        """Make a folder if there is none, and check that files of these names can be written."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except FileExistsError:
            self.error(f"{folder}: is a file; give a folder")
        except NotADirectoryError:
            self.error(f"{folder}: part of this path is a file; give another folder")
        except (OSError, ValueError) as error:
            self.error(f"{folder}: nothing can be written there ({_reason(error)})")
        for name in names:
            self._require_writable(folder / name)

    def require_file(self, path: Path) -> None:
        """Check that a file can be written, and make its folder."""
        if not os.path.isdir(path):
            self.require_folder(path.parent)
        self._require_writable(path)

    def require_page(self, page: Path, marks: re.Pattern[str], wanted: str) -> None:
        """Check that a page exists, can be written, and has the marks around its text.

        Args:
            page: a text file.
            marks: what must be found in it.
            wanted: the marks as a user should write them.
        """
        if not os.path.isfile(page):
            self.error(f"{page}: no such file; give a page of text")
        self._require_writable(page)
        try:
            text = page.read_text()
        except (OSError, UnicodeDecodeError) as error:
            self.error(f"{page}: cannot be read as text ({_reason(error)})")
        if not marks.search(text):
            self.error(f"{page}: has no place to fill: put the lines {wanted} where you want it")

    def _require_writable(self, path: Path) -> None:
        try:
            for each in (path, part_of(path)):
                new = not os.path.lexists(each)
                with each.open("ab"):
                    pass
                if new:
                    each.unlink()
        except IsADirectoryError:
            self.error(f"{path}: is a folder, but a file is to be written there; give another path")
        except OSError as error:
            self.error(f"{path}: cannot be written ({_reason(error)}); give another place")


def _reason(error: Exception) -> str:
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def whole(least: int, most: int | None = None) -> Callable[[str], int]:
    """The type of an argument that is an integer from `least` to `most`, such as 20 or 2e7."""

    def parsed(text: str) -> int:
        try:
            return integer("it", _integer_in(text), least, most)
        except ValueError:
            limits = f"of at least {least}" + ("" if most is None else f" and at most {most}")
            message = f"{text!r}: must be an integer {limits}"
            raise argparse.ArgumentTypeError(message) from None

    return parsed


def _integer_in(text: str) -> int:
    """The integer that a text is.

    Raises:
        ValueError: it is not an integer.
    """
    if "e" not in text:
        return int(text)
    number = float(text)
    if not number.is_integer():
        raise ValueError(f"{text}: not an integer")
    return int(number)


def more_than_zero(text: str) -> float:
    """The type of an argument that is a finite number greater than 0."""
    try:
        return positive("it", float(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: must be a number greater than 0") from None


def json_object(parsed: Callable[[dict[str, Any]], T]) -> Callable[[str], T]:
    """The type of an argument that is a JSON object, which `parsed` turns into a value."""

    def read(text: str) -> T:
        try:
            values = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise argparse.ArgumentTypeError(f"{text[:200]!r}: not JSON ({error})") from None
        if not isinstance(values, dict):
            raise argparse.ArgumentTypeError(f"{text!r}: must be a JSON object, {{...}}")
        try:
            return parsed(values)
        except (TypeError, ValueError) as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read


@contextmanager
def terminated_like_ctrl_c() -> Iterator[None]:
    """Within the block, SIGTERM, which batch systems send to end a job, acts like Ctrl-C."""

    def press(number: int, frame: FrameType | None) -> None:
        signal.raise_signal(signal.SIGINT)

    before = {signal.SIGTERM: signal.signal(signal.SIGTERM, press)}
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # a shell started it with &
        before[signal.SIGINT] = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
