#!/usr/bin/env python
"""What most of the scripts do, as one command: rimless WORD, with its own --help."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rimless_gym.extras import MissingExtraError
from scripts.commandline import INTERRUPTED


class Command(NamedTuple):
    """A word after `rimless`.

    Attributes:
        module: whose `main` takes its arguments; imported only when it is asked for.
        meaning: one line.
    """

    module: str
    meaning: str


COMMANDS = {
    "watch": Command("scripts.watch", "the optimum, laws and policies, in a window or as a GIF"),
    "play": Command("scripts.play", "walk yourself, with the arrow keys"),
    "gait": Command("scripts.solve_gait", "find the optimal gait of a machine"),
    "train": Command("scripts.train", "train a policy"),
    "evaluate": Command("scripts.evaluate", "measure policies and feedback laws"),
    "compare": Command("scripts.compare", "learned against optimal: the main job"),
    "page": Command("scripts.page", "one HTML file to pass on: the front, a wheel to drive"),
    "data": Command("scripts.data", "walks as Minari datasets, for offline learners"),
    "thesis": Command("scripts.thesis.command", "the thesis's experiments"),
    "bench": Command("scripts.benchmarks.command", "speed, ours and other people's"),
    "warmup": Command("scripts.warmup", "compile the simulator now"),
    "codesign": Command("scripts.codesign.command", "which machine walks best"),
    "feedback": Command("scripts.feedback_laws.command", "feedback laws, measured"),
    "front": Command("scripts.fronts.command", "search a machine's front of gaits anew"),
    "fuzz": Command("scripts.fuzzing.command", "random machines, every step checked"),
    "learning": Command("scripts.learning_trials.command", "why learning to walk is hard"),
    "robustness": Command("scripts.robust_policies.command", "policies under disturbances"),
    "study": Command("scripts.studies.command", "every learner over several seeds"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit status is its own, 2 where there is no such command."""
    word, *rest = (sys.argv[1:] if arguments is None else arguments) or ["--help"]
    if word in ("-h", "--help"):
        print(usage())
        return 0
    if word not in COMMANDS:
        print(f"error: {word!r} is no command: {', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    sys.argv[0] = f"rimless {word}"  # what its --help calls it
    try:
        found = import_module(COMMANDS[word].module)
        return int(found.main(rest))
    except MissingExtraError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


def usage() -> str:
    """All commands, one a line."""
    width = max(map(len, COMMANDS))
    lines = [f"  {word:{width}}  {command.meaning}" for word, command in COMMANDS.items()]
    return "\n".join(["usage: rimless COMMAND ...; rimless COMMAND --help has its options", *lines])


if __name__ == "__main__":
    sys.exit(main())
