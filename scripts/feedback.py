#!/usr/bin/env python
"""Measure every feedback law about several held gaits; see `--help`."""

import sys
from pathlib import Path

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.feedback_laws.command import main

if __name__ == "__main__":
    sys.exit(main())
