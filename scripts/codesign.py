#!/usr/bin/env python
"""Choose the machine BUILDABLE: gears, legs, bob and arm, and which of them start; see `--help`."""

import sys
from pathlib import Path

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.codesign.command import main

if __name__ == "__main__":
    sys.exit(main())
