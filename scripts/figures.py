#!/usr/bin/env python
"""Regenerate every figure and every number of docs/physics.md and docs/thesis-errata.md.

Writes PNG files and numbers.json, and the tables into the two documents where they lie beside the
folder. A test compares the documents with numbers.json, and numbers.json with the code.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rimless_gym.params import PRESETS
from scripts.commandline import Parser
from scripts.documents import accuracy, drawings, errata, integrator, machines, plots
from scripts.documents.tables import filled, tables

DOCUMENTS = ("physics.md", "thesis-errata.md")

FIGURES = ("coordinates.png", "modes.png", "convergence.png", "rest.png", "impact.png")


def numbers() -> dict[str, Any]:
    """Everything that the two documents quote."""
    return {
        "accuracy": accuracy.accuracy(count=10, grazes=400),
        "missed_dips": accuracy.missed_dips(200_000),
        "convergence": integrator.convergence(),
        "coming_to_rest": machines.coming_to_rest(),
        "printed_impact": errata.printed_impact(),
        "new_foot_momentum": errata.new_foot_momentum(),
        "generalised_force": errata.generalised_force(),
        "rotor": errata.rotor(),
        "motor_pole": {name: params.motor_pole for name, params in PRESETS.items()},
        "reach_and_hub": {name: machines.reach_and_hub(of) for name, of in PRESETS.items()},
        "kappa": {name: machines.kappa_range(of) for name, of in PRESETS.items()},
        "kappa_of_few_legs": machines.kappa_of_few_legs(),
    }


def figures(results: dict[str, Any]) -> dict[str, Figure]:
    """Every figure by file name."""
    plt.rcParams |= {"axes.spines.top": False, "axes.spines.right": False, "font.size": 10}
    drawn = (
        drawings.coordinates_figure(),
        drawings.modes_figure(),
        plots.convergence_figure(results["convergence"]),
        plots.rest_figure(results["coming_to_rest"]),
        plots.impact_figure(),
    )
    return dict(zip(FIGURES, drawn, strict=True))


def _recorded(path: Path) -> dict[str, Any]:
    """The numbers of an earlier run.

    Raises:
        FileNotFoundError: there are none.
        ValueError: they are damaged, or of another version.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; leave out --keep-numbers once")
    try:
        results = json.loads(path.read_text())
        tables(results)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(
            f"{path}: damaged, or of another version ({error!r}); leave out --keep-numbers once"
        ) from error
    return dict(results)


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


if __name__ == "__main__":
    sys.exit(main())
