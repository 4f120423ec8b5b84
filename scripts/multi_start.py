#!/usr/bin/env python
"""Look for the local optima of a problem from many starts; see `--help`."""

import sys
from pathlib import Path

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.multi_start.command import main

if __name__ == "__main__":
    sys.exit(main())
