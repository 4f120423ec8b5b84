"""Everything that the two documents show: their numbers and their figures."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from rimless_gym.presets import PRESETS
from scripts.studies.documents import (
    accuracy,
    dips,
    drawings,
    errata,
    integrator,
    machines,
    plots,
)

DOCUMENTS = ("physics.md", "thesis-errata.md")

FIGURES = ("coordinates.png", "modes.png", "convergence.png", "rest.png", "impact.png")


def numbers() -> dict[str, Any]:
    """Every number that the two documents quote."""
    return {
        "accuracy": accuracy.accuracy(count=10, grazes=400),
        "missed_dips": dips.missed_dips(200_000),
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
    """Every figure by the name of its file, drawn from the results of `numbers`."""
    plt.rcParams |= {"axes.spines.top": False, "axes.spines.right": False, "font.size": 10}
    drawn = (
        drawings.coordinates_figure(),
        drawings.modes_figure(),
        plots.convergence_figure(results["convergence"]),
        plots.rest_figure(results["coming_to_rest"]),
        plots.impact_figure(),
    )
    return dict(zip(FIGURES, drawn, strict=True))
