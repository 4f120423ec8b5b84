#!/usr/bin/env python
"""The command `rimless`, in a checkout; without arguments, all its words."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from rimless_gym.command import main

if __name__ == "__main__":
    sys.exit(main())
