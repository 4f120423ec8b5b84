"""`python -m scripts.studies NAME ...` runs a study; `--help` after its name lists its options."""

from __future__ import annotations

import importlib
import sys

from agents.cli.main import INTERRUPTED, REFUSED, run
from rimless_gym.checks import MissingExtraError

#: Modules of this package, by the names of the studies. Each has a function `main`, or one that
#: has the study's name and its options.
STUDIES = {
    "assumptions": "assumptions",
    "benchmark": "benchmark.run",
    "bounds": "bounds",
    "codesign": "codesign.command",
    "collisionless": "collisionless",
    "feedback": "feedback_laws.command",
    "figures": "documents.figures",
    "front": "fronts.command",
    "learning": "learning.command",
    "mutants": "mutants",
    "own_wheel": "own_wheel",
    "processors": "processors",
    "publish": "publish",
    "returns": "returns",
    "stops": "fronts.strides",
    "strides": "fronts.strides",
    "textbook": "textbook",
    "thesis": "thesis.experiments",
}


def main() -> int:
    """Run the study that the first argument names; exit status 2 if there is none."""
    name, *arguments = sys.argv[1:] or ["--help"]
    if name not in STUDIES:
        print(f"usage: python -m scripts.studies NAME ...; names: {', '.join(STUDIES)}")
        return 0 if name in ("-h", "--help") else 2
    sys.argv[0] = f"python -m scripts.studies {name}"
    try:
        return run_study(name, arguments)
    except MissingExtraError as error:
        print(f"error: {error}", file=sys.stderr)
        return REFUSED
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED


def run_study(name: str, arguments: list[str]) -> int:
    """Run a study by its name."""
    module = importlib.import_module(f"scripts.studies.{STUDIES[name]}")
    if hasattr(module, "main"):
        return int(module.main(arguments))
    return run(getattr(module, name), arguments, f"python -m scripts.studies {name}")


if __name__ == "__main__":
    sys.exit(main())
