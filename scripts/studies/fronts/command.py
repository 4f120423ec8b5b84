"""Search a machine's front of least cost of transport, as a rival would search it.

Two independent seeds screen families of gaits with random starts and lead the good ones from speed
to speed, until both agree; a last sweep looks for anything better. The gaits are solved on fine
meshes, verified, and shipped with the package: trajopt/gaits/library. A record of the search is
written beside them, and a table and a figure into docs/front.md. Everything is kept in files: after
Ctrl-C or a kill the same command goes on from there, and with more --minutes it searches further.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one process per core is enough

from agents.cli.main import INTERRUPTED
from rimless_gym.params import WheelParams
from scripts.studies.commandline import (
    DEFAULT_PRESET,
    Parser,
    more_than_zero,
    terminated_like_ctrl_c,
    whole,
)
from scripts.studies.documents.drawings import save
from scripts.studies.fronts import page
from scripts.studies.fronts.board import Board
from scripts.studies.fronts.campaign import searched
from scripts.studies.fronts.crew import crew
from scripts.studies.fronts.drawing import drawn
from scripts.studies.fronts.fine import polished
from scripts.studies.fronts.library import record_file, ship
from scripts.studies.fronts.record import chosen, record, same_machine
from trajopt.files import write_text
from trajopt.gaits.library import ARCHIVE, shipped
from trajopt.gaits.problem import fastest_walk

ROOT = Path(__file__).resolve().parents[3]

#: A search that took less than this share of the shipped one's time does not replace it.
SHORTER = 0.9


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit status is 130 after Ctrl-C or SIGTERM."""
    parser = Parser(__doc__)
    parser.add_machine(
        DEFAULT_PRESET, "machine; with --params its gaits stay in --out, for a trial"
    )
    parser.add_argument(
        "--minutes", type=more_than_zero, default=120.0, help="budget of time, on all workers"
    )
    parser.add_argument("--workers", type=whole(1), default=os.cpu_count(), help="processes")
    parser.add_argument("--grid", type=more_than_zero, default=0.05, help="of speeds (m/s)")
    parser.add_argument("--out", type=Path, default=Path("runs/front"), help="folder of the search")
    options = parser.parse_args(arguments)
    params, trial = parser.machine(options), bool(options.params)
    name = options.preset + ("_CHANGED" if trial else "")
    folder = options.out / name
    with parser.refusing():
        parser.require_folder(folder, "machine.json")
        _same_search(folder / "machine.json", params, options.grid)
        if options.grid > fastest_walk(params):
            raise ValueError(
                f"--grid = {options.grid:g}: must be at most {fastest_walk(params):.3g} m/s, the "
                "fastest walk of this machine"
            )
    library = folder / "library" if trial else ARCHIVE.parent
    docs = folder / "docs" if trial else ROOT / "docs"
    try:
        with terminated_like_ctrl_c(), parser.refusing(), parser.out_of_room(folder):
            found = _searched(name, params, folder, options, library)
    except KeyboardInterrupt:
        print(
            f"\ninterrupted: what was found is in {folder}; the same command goes on from there",
            file=sys.stderr,
        )
        return INTERRUPTED
    docs.mkdir(exist_ok=True)
    text = docs / "front.md"
    if not text.exists():
        text.write_text(f"# The front of {name}\n")
    page.refresh(text, found)
    save(drawn(found), docs / page.figure_file(name))
    print(page.section(found))
    return 0


def _searched(
    name: str, params: WheelParams, folder: Path, options: argparse.Namespace, library: Path
) -> dict[str, Any]:
    """Search, ship the gaits, and return the record."""
    search = folder / "search"
    search.mkdir(exist_ok=True)
    board, budget = Board(params, search), 60.0 * options.minutes * options.workers
    with crew(options.workers) as workers:
        sweeps = searched(board, options.grid, budget, workers)
        done = polished(board, folder / "gaits", workers, budget)
    gaits = chosen(done, same_machine(shipped(), params))
    found = record(name, board, gaits, done, sweeps, options.minutes, options.workers)
    require_more_search(found, library / record_file(name))
    size = ship(library, name, gaits, found)
    print(f"{len(gaits)} gaits, {size / 1e6:.2f} MB, are in {library}")
    return found


def require_more_search(found: dict[str, Any], path: Path) -> None:
    """Refuse to replace the record of a longer search by that of a shorter one.

    Raises:
        ValueError: the shipped one was longer.
    """
    spent = "search_of_one_core"
    before = json.loads(path.read_text())["minutes"][spent] if path.exists() else 0.0
    if found["minutes"][spent] < SHORTER * before:
        raise ValueError(
            f"{path.name}: the shipped front was searched for {before:.0f} minutes of one core, "
            f"this one for {found['minutes'][spent]:.0f}, so it is not replaced; the same command "
            "with more --minutes goes on"
        )


def _same_search(path: Path, params: WheelParams, grid: float) -> None:
    """Refuse to go on with a search of another machine or grid in the same folder.

    Raises:
        ValueError: the folder's search is another one.
    """
    wanted = json.dumps({"params": params.to_dict(), "grid": grid}, indent=1) + "\n"
    if path.exists() and path.read_text() != wanted:
        raise ValueError(
            f"{path.parent}: holds the search of another machine or --grid; give another --out, or "
            "delete the folder"
        )
    if not path.exists() and (path.parent / "search").exists():
        raise ValueError(
            f"{path.parent}: its {path.name} is gone, so that nobody knows whose search it holds; "
            "give another --out, or delete the folder"
        )
    write_text(path, wanted)
