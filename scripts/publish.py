#!/usr/bin/env python
"""Copy a finished comparison's table, plots, animation and policies into the README and package."""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from scripts.commandline import Parser

ROOT = Path(__file__).resolve().parents[1]
COPIES = {
    "imitation.gif": "docs/walking.gif",
    "cot_against_speed.png": "docs/cot_against_speed.png",
    "limit_cycles.png": "docs/limit_cycles.png",
    "imitation/clone.zip": "agents/pretrained/imitation.zip",
    "fine_tuned/best.zip": "agents/pretrained/fine_tuned.zip",
    "evolution/best.zip": "agents/pretrained/evolution.zip",
}
TABLE = re.compile(r"(<!-- table: .*? -->\n).*?(<!-- end of table -->)", re.DOTALL)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = Parser(__doc__)
    parser.add_argument("--study", type=Path, default=Path("runs/compare"), help="of make compare")
    study = parser.parse_args(arguments).study
    for source in ("table.md", *COPIES):
        if not (study / source).is_file():
            parser.error(f"{study / source} is missing: run make compare to its end first")
    readme, table = ROOT / "README.md", (study / "table.md").read_text()
    parser.require_page(readme, TABLE, "<!-- table: ... --> and <!-- end of table -->")
    text, found = TABLE.subn(lambda m: m[1] + table + m[2], readme.read_text())
    if found != 1:
        parser.error(f"{readme}: has {found} marked tables, not 1; leave one of them")
    for target in COPIES.values():
        parser.require_file(ROOT / target)
    for source, target in COPIES.items():
        shutil.copyfile(study / source, ROOT / target)
    readme.write_text(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
