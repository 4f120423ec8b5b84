"""`python -m scripts.studies NAME ...` runs a study; `--help` after its name lists its options."""

from __future__ import annotations

import importlib
import sys

from agents.cli.main import REFUSED, run
from rimless_gym.checks import MissingExtraError

#: Modules of this package, by the names of the studies. Each has a function of the study's name,
#: whose options are its parameters.
STUDIES = {
    "accelerator": "accelerator",
    "assumptions": "assumptions",
    "benchmark": "benchmark.run",
    "bounds": "bounds",
    "cluster": "cluster",
    "collisionless": "collisionless",
    "feedback": "feedback_laws.command",
    "figures": "documents.figures",
    "front": "fronts.command",
    "learning": "learning.command",
    "own_wheel": "own_wheel",
    "processors": "processors",
    "publish": "publish",
    "rejax_ppo": "rejax_ppo",
    "rests": "fronts.rests",
    "returns": "returns",
    "robustness": "robustness",
    "stops": "fronts.strides",
    "strides": "fronts.strides",
    "terrain": "terrain",
    "textbook": "textbook",
    "thesis": "thesis.experiments",
}


def main() -> int:
    """Run the study that the first argument names; exit status 2 if there is none."""
    name, *arguments = sys.argv[1:] or ["--help"]
    if name not in STUDIES:
        print(f"usage: python -m scripts.studies NAME ...; names: {', '.join(STUDIES)}")
        return 0 if name in ("-h", "--help") else 2
    try:
        return run_study(name, arguments)
    except MissingExtraError as error:  # of a study's own imports
        print(f"error: {error}", file=sys.stderr)
        return REFUSED


def run_study(name: str, arguments: list[str]) -> int:
    """Run a study by its name."""
    module = importlib.import_module(f"scripts.studies.{STUDIES[name]}")
    return run(getattr(module, name), arguments, f"python -m scripts.studies {name}")


if __name__ == "__main__":
    sys.exit(main())
