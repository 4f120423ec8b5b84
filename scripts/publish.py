#!/usr/bin/env python
"""Put a finished comparison's table, plots, animation and policies where the README shows them."""

from __future__ import annotations

import argparse
import re
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
COPIES = {
    "imitation.gif": "docs/walking.gif",
    "cot_against_speed.png": "docs/cot_against_speed.png",
    "limit_cycles.png": "docs/limit_cycles.png",
    "imitation/clone.zip": "agents/pretrained/imitation.zip",
    "fine_tuned/best.zip": "agents/pretrained/fine_tuned.zip",
}
TABLE = re.compile(r"(<!-- table: .*? -->\n).*?(<!-- end of table -->)", re.DOTALL)


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    parser.add_argument("--study", type=Path, default=Path("runs/compare"), help="of make compare")
    study = parser.parse_args().study
    table = study / "table.md"
    if not table.exists():
        parser.exit(2, f"error: {table} is missing: run make compare to its end first\n")
    for source, target in COPIES.items():
        (ROOT / target).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(study / source, ROOT / target)
    readme = ROOT / "README.md"
    text, found = TABLE.subn(lambda m: m[1] + table.read_text() + m[2], readme.read_text())
    if found != 1:
        parser.exit(2, f"error: {readme} has {found} marked tables, not 1\n")
    readme.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
