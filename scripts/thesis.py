#!/usr/bin/env python
"""Solve the thesis's experiments, or ask whether its prototype can walk; see `--help`."""

import sys
from pathlib import Path

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.thesis.command import main

if __name__ == "__main__":
    sys.exit(main())
