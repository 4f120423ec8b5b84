"""`python -m rimless_gym` is the command `rimless`, which layers above this package define."""

import sys
from importlib.metadata import distribution

if __name__ == "__main__":
    (command,) = distribution("rimless-gym").entry_points.select(group="console_scripts")
    sys.exit(command.load()())
