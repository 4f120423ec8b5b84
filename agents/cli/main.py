"""The command `rimless`: one word for each thing that users do.

Options and their descriptions are those of the functions in `COMMANDS`. The functions import what
they compute with only when they run, so that help appears at once.
"""

from __future__ import annotations

import difflib
import functools
import importlib.metadata
import inspect
import io
import os
import re
import signal
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr
from types import FrameType
from typing import Any, get_type_hints

import tyro

from agents.cli.evaluate import evaluate
from agents.cli.gait import catalog, gait, warmup
from agents.cli.identify import identify, log
from agents.cli.learn import compare, train, tune
from agents.cli.options import MaybeAddress, joined_fields
from agents.cli.watch import data, page, play, watch

#: Exit status: of refused input; of commands ended by Ctrl-C; of output that nobody reads.
REFUSED, INTERRUPTED, UNREAD = 2, 130, 141

#: The option of every command that has `--workers`.
CLUSTER = "cluster: work on dask://HOST:PORT, ray://HOST:PORT, or auto: Dask on this computer"

COMMANDS: Mapping[str, Callable[..., int]] = {
    "train": train,
    "evaluate": evaluate,
    "compare": compare,
    "tune": tune,
    "gait": gait,
    "watch": watch,
    "play": play,
    "page": page,
    "data": data,
    "log": log,
    "identify": identify,
    "list": catalog,
    "warmup": warmup,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run `rimless` with these arguments, by default those of the process; the exit status."""
    warnings.formatwarning = lambda message, *_, **__: f"warning: {message}\n"
    words = list(sys.argv[1:] if arguments is None else arguments) or ["--help"]
    word = words[0]
    if word in ("-h", "--help"):
        return run(lambda: print(usage()) or 0, [])
    if word == "--version":
        print(f"rimless-gym {importlib.metadata.version('rimless-gym')}")
        return 0
    if not word.startswith("-") and word not in COMMANDS:
        near = difflib.get_close_matches(word, COMMANDS, 1)
        meant = f"did you mean {near[0]!r}?" if near else f"choose from {', '.join(COMMANDS)}"
        return _refused(f"{word!r} is no command: {meant}")
    if word in COMMANDS:
        return run(COMMANDS[word], words[1:], f"rimless {word}")
    return run(COMMANDS, words, "rimless")  # completion, or a wrong option


def usage() -> str:
    """All commands, one a line."""
    about = {word: (f.__doc__ or "").partition("\n")[0] for word, f in COMMANDS.items()}
    lines = [f"  {word:9} {line}" for word, line in about.items()]
    return "\n".join(
        [
            "usage: rimless COMMAND ...",
            "",
            *lines,
            "",
            "`rimless COMMAND --help` lists the options of a command; `rimless --version` is the",
            "version; `rimless --tyro-print-completion bash` (or zsh, tcsh) completes in a shell.",
        ]
    )


def run(
    command: Callable[..., int] | Mapping[str, Callable[..., int]],
    arguments: Sequence[str] | None = None,
    program: str | None = None,
) -> int:
    """Run a function with options from its signature, or the one that the first argument names.

    Bad input ends in one line and status 2, Ctrl-C and SIGTERM in status 130.

    Args:
        command: takes options as `agents.cli.options` reads them, and returns an exit status.
        arguments: of the command line; None: those of this process.
        program: its name in help.
    """
    words = joined_fields(sys.argv[1:] if arguments is None else arguments)
    if isinstance(sys.stdout, io.TextIOWrapper):  # as on stderr: a file may have any name
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        with _unread_quietly(), _terminated_like_ctrl_c():
            return _parsed(command, words, program)()
    except KeyboardInterrupt as error:
        print(": ".join(["\ninterrupted", *map(str, error.args)]), file=sys.stderr)
        return INTERRUPTED
    except Exception as error:
        if not _expected(error):
            raise
        return _refused(_words(error))


def _refused(message: str) -> int:
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    return REFUSED


def _expected(error: Exception) -> bool:
    """Whether an error is about the input or the computer, rather than a fault of the program."""
    if isinstance(error, (ValueError, OSError)):
        return True
    from rimless_gym.checks import KindError, MissingExtraError
    from trajopt.pool import KilledError

    return isinstance(error, (KindError, MissingExtraError, KilledError))


def _words(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def _parsed(
    command: Callable[..., int] | Mapping[str, Callable[..., int]],
    words: Sequence[str],
    program: str | None,
) -> Callable[[], int]:
    """The call that the arguments describe; SystemExit: help was printed, or they are refused."""
    settings: dict[str, Any] = {
        "args": words,
        "prog": program,
        "config": (tyro.conf.FlagCreatePairsOff,),
    }
    complaints = io.StringIO()
    try:
        with redirect_stderr(complaints):
            if callable(command):
                return tyro.cli(_later(command), **settings)
            app = tyro.extras.SubcommandApp()
            for word, function in command.items():
                app.command(name=word)(_later(function))
            return app.cli(**settings)
    except SystemExit as end:
        if end.code:
            raise SystemExit(_refused(_complaint(complaints.getvalue()))) from None
        raise


def _later(function: Callable[..., int]) -> Callable[..., Callable[[], int]]:
    """A function with the options of a command that returns its call instead of making it."""

    def call(*arguments: object, **options: object) -> Callable[[], int]:
        return functools.partial(function, *arguments, **options)

    call.__name__ = function.__name__
    call.__annotations__ = get_type_hints(function, include_extras=True)
    signature, about = inspect.signature(function), inspect.cleandoc(function.__doc__ or "")
    if "workers" in signature.parameters:
        function = _on_cluster(function)
        call.__annotations__["cluster"] = MaybeAddress
        option = inspect.Parameter("cluster", inspect.Parameter.KEYWORD_ONLY, default=None)
        signature = signature.replace(parameters=[*signature.parameters.values(), option])
        about = re.sub(r"^( *)workers: .*(\n\1 .*)*", rf"\g<0>\n\g<1>{CLUSTER}", about, flags=re.M)
    call.__signature__ = signature  # type: ignore[attr-defined]
    # tyro keeps line breaks in the description of an option
    call.__doc__ = re.sub(r"\n {8}", " ", about)
    return call


def _on_cluster(command: Callable[..., int]) -> Callable[..., int]:
    """A command with workers and the option `cluster`, on whose workers it does its work."""

    @functools.wraps(command)
    def run(*arguments: object, cluster: str | None, workers: int | None, **options: object) -> int:
        if cluster is None:
            return command(*arguments, workers=workers, **options)
        from trajopt.cluster import connected

        with connected(cluster, workers):
            return command(*arguments, workers=workers, **options)

    return run


def _complaint(box: str) -> str:
    """What tyro prints in a box about refused arguments, in one line.

    A title and a rule stand above the message, and another rule below it.
    """
    lines = [line.strip("│ ") for line in box.splitlines()][1:]
    sections = "\n".join("" if re.fullmatch("[─-]{2,}|", line) else line for line in lines)
    message, *rest = re.split(r"\n{2,}|^\n", sections.strip())
    first = " ".join(message.split()).removeprefix("Error parsing ")
    near = re.search(r"^--[\w-]+", "\n".join(rest), re.MULTILINE)
    if near and any(section.startswith("Perhaps you meant:") for section in rest):
        first += f"; did you mean {near[0]}?"
    return first


@contextmanager
def _unread_quietly() -> Iterator[None]:
    """End without a traceback where nobody reads the output, as in `rimless list | head -3`."""
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(UNREAD) from None


@contextmanager
def _terminated_like_ctrl_c() -> Iterator[None]:
    """Let SIGTERM, which batch systems send to end a job, act like Ctrl-C."""

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


if __name__ == "__main__":
    sys.exit(main())
