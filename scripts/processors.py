#!/usr/bin/env python
"""Run the tests as other processors would run them; see `--help`."""

import sys
from pathlib import Path

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.processors.command import main

if __name__ == "__main__":
    sys.exit(main())
