#!/usr/bin/env python
"""Measure what an episode pays, whoever walks; see `--help`."""

import sys
from pathlib import Path

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.episode_returns.command import main

if __name__ == "__main__":
    sys.exit(main())
