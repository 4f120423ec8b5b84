#!/usr/bin/env python
"""Train and judge every learner over several seeds; see `--help`."""

import sys
from pathlib import Path

if not __package__:  # run as a file
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.studies.command import main

if __name__ == "__main__":
    sys.exit(main())
