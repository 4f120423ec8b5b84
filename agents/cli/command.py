"""The command `rimless`: one word for each thing that users do.

This file imports none of that before it knows what is asked for, and whether it can be had.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import NamedTuple

from rimless_gym.checks import MissingExtraError

#: The exit status that shells give a command ended by Ctrl-C.
INTERRUPTED = 130

#: The same for a command whose output nobody reads any more.
UNREAD = 141


class Command(NamedTuple):
    """A word after `rimless`.

    Attributes:
        module: in `agents.cli`; its `main` takes the arguments.
        meaning: one line.
    """

    module: str
    meaning: str


COMMANDS = {
    "watch": Command("watch", "the optimum, laws and policies, in a window, as a GIF or a video"),
    "play": Command("play", "walk yourself, with the arrow keys"),
    "gait": Command("solve_gait", "find the optimal gait of a machine"),
    "train": Command("train", "train a policy"),
    "evaluate": Command("evaluate", "measure policies and feedback laws"),
    "compare": Command("compare", "learned against optimal: the main job"),
    "page": Command("page", "one HTML file to pass on: the front, a wheel to drive"),
    "data": Command("data", "walks as Minari datasets, for offline learners"),
    "warmup": Command("warmup", "compile the simulator now"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command that a word stands for; the exit status is 2 where there is none."""
    word, *rest = (sys.argv[1:] if arguments is None else arguments) or ["--help"]
    if word in ("-h", "--help"):
        with unread_quietly():
            print(usage())
        return 0
    if word not in COMMANDS:
        print(f"error: {word!r} is no command: {', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    sys.argv[0] = f"rimless {word}"  # what its --help calls it
    return run(f"agents.cli.{COMMANDS[word].module}", rest)


def run(module: str, arguments: Sequence[str] | None = None) -> int:
    """Run the `main` of a module.

    Args:
        module: such as `agents.cli.train`; it is imported only now.
        arguments: of the command line; None: those of this process.

    Returns:
        The exit status: its own, 2 if what it needs is not installed, 130 after Ctrl-C.
    """
    try:
        main = import_module(module).main
        with unread_quietly():
            return int(main(arguments))
    except MissingExtraError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


@contextmanager
def unread_quietly() -> Iterator[None]:
    """End without a word if nobody reads the output any more, as in `rimless --help | head -3`.

    Nothing else that fails is hidden.
    """
    ended: SystemExit | None = None
    try:
        try:
            yield
        except SystemExit as end:
            ended = end
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(UNREAD) from None
    if ended is not None:
        raise ended


def usage() -> str:
    """All commands, one a line."""
    width = max(map(len, COMMANDS))
    lines = [f"  {word:{width}}  {command.meaning}" for word, command in COMMANDS.items()]
    return "\n".join(["usage: rimless COMMAND ...; rimless COMMAND --help has its options", *lines])


if __name__ == "__main__":
    sys.exit(main())
