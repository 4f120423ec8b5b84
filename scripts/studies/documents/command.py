"""Regenerate every figure and every number of docs/physics.md and docs/thesis-errata.md.

Writes PNG files and numbers.json into a folder, and the tables into the two documents if they are
beside that folder. A test compares the documents with numbers.json, and numbers.json with what the
code gives.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.cli.commandline import Parser
from scripts.studies.documents import plots
from scripts.studies.documents.contents import DOCUMENTS, FIGURES, figures, numbers
from scripts.studies.documents.tables import filled, tables


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = Parser(__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/figures"), help="folder to write to")
    parser.add_argument(
        "--keep-numbers", action="store_true", help="draw from the numbers.json that is there"
    )
    options = parser.parse_args(arguments)
    path = options.out / "numbers.json"
    pages = [page for name in DOCUMENTS if (page := options.out.parent / name).exists()]
    parser.require_folder(options.out, "numbers.json", *FIGURES)
    for page in pages:
        parser.require_file(page)
    if options.keep_numbers:
        with parser.refusing():
            results = _recorded(path)
    else:
        results = numbers()
        path.write_text(json.dumps(results, indent=1) + "\n")
    for name, figure in figures(results).items():
        plots.save(figure, options.out / name)
    for page in pages:
        page.write_text(filled(page.read_text(), results))
    for name, text in tables(results).items():
        print(f"\n{name}\n\n{text}")
    return 0


def _recorded(path: Path) -> dict[str, Any]:
    """The numbers of an earlier run.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file is damaged, or from another version.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; leave out --keep-numbers once")
    try:
        results = json.loads(path.read_text())
        tables(results)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{path}: damaged, or from another version ({error!r}); leave out --keep-numbers once"
        ) from error
    return dict(results)
