#!/usr/bin/env python
"""Step the compiled environment on random machines, and check every step; see `--help`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from rimless_gym.command import run

if __name__ == "__main__":
    sys.exit(run("fuzzing.command"))
