#!/usr/bin/env python
"""Measure how robust learned policies are, beside the LQR; see `--help`."""

import sys
from pathlib import Path

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.robust_policies.command import main

if __name__ == "__main__":
    sys.exit(main())
