#!/usr/bin/env python
"""Try why learning to walk from nothing is hard, and what helps; see `--help`."""

import sys
from pathlib import Path

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.learning_trials.command import main

if __name__ == "__main__":
    sys.exit(main())
