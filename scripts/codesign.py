#!/usr/bin/env python
"""Choose the machine BUILDABLE: gears, legs, bob and arm, and which of them start; see `--help`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from rimless_gym.command import run

if __name__ == "__main__":
    sys.exit(run("codesign.command"))
