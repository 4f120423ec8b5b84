#!/usr/bin/env python
"""Watch the optimum, laws and policies, in a window, as a GIF or a video; see `--help`."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from rimless_gym.command import run

if __name__ == "__main__":
    sys.exit(run("watch"))
