#!/usr/bin/env python
"""Regenerate every figure and every number of docs/physics.md and docs/thesis-errata.md.

Writes PNG files and numbers.json, and the tables into the two documents where they lie beside the
folder. A test compares the documents with numbers.json, and numbers.json with the code.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rimless_gym.params import PRESETS
from scripts.documents import accuracy, drawings, errata, integrator, machines, plots
from scripts.documents.tables import filled, tables

DOCUMENTS = ("physics.md", "thesis-errata.md")


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
    return {
        "coordinates.png": drawings.coordinates_figure(),
        "modes.png": drawings.modes_figure(),
        "convergence.png": plots.convergence_figure(results["convergence"]),
        "rest.png": plots.rest_figure(results["coming_to_rest"]),
        "impact.png": plots.impact_figure(),
    }


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("docs/figures"), help="folder to write to")
    parser.add_argument(
        "--keep-numbers", action="store_true", help="draw from the numbers.json that is there"
    )
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / "numbers.json"
    if arguments.keep_numbers:
        results = json.loads(path.read_text())
    else:
        results = numbers()
        path.write_text(json.dumps(results, indent=1) + "\n")
    for name, figure in figures(results).items():
        plots.save(figure, arguments.out / name)
    for page in (arguments.out.parent / name for name in DOCUMENTS):
        if page.exists():
            page.write_text(filled(page.read_text(), results))
    for name, text in tables(results).items():
        print(f"\n{name}\n\n{text}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
