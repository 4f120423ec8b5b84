"""`python -m scripts.studies NAME ...` runs a study; `--help` after its name lists its options."""

from __future__ import annotations

import sys

from agents.cli.command import run

#: Modules of this package, by the names of the studies. Each has a function `main`.
STUDIES = {
    "benchmark": "benchmark.run",
    "codesign": "codesign.command",
    "feedback": "feedback_laws.command",
    "figures": "documents.figures",
    "front": "fronts.command",
    "learning": "learning.command",
    "processors": "processors",
    "publish": "publish",
    "publish_policy": "publish_policy",
    "returns": "returns",
    "textbook": "textbook",
    "thesis": "thesis.command",
}


def main() -> int:
    """Run the study that the first argument names; exit status 2 if there is none."""
    name, *arguments = sys.argv[1:] or ["--help"]
    if name not in STUDIES:
        print(f"usage: python -m scripts.studies NAME ...; names: {', '.join(STUDIES)}")
        return 0 if name in ("-h", "--help") else 2
    sys.argv[0] = f"python -m scripts.studies {name}"
    return run(f"scripts.studies.{STUDIES[name]}", arguments)


if __name__ == "__main__":
    sys.exit(main())
