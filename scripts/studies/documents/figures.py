"""The study `figures`: the numbers and tables of docs/physics.md and docs/thesis-errata.md."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from agents.cli.options import Flag
from rimless_gym.energy import CHANNELS
from rimless_gym.presets import PRESETS
from scripts.studies.documents import accuracy, errata
from scripts.studies.documents.accuracy import CASES
from scripts.studies.documents.markdown import table

DOCUMENTS = ("physics.md", "thesis-errata.md")


def figures(
    *,
    out: Path = Path("docs/figures"),
    keep_numbers: Flag = False,
) -> int:
    """Regenerate every number of docs/physics.md and docs/thesis-errata.md.

    Writes numbers.json, and the tables into the two documents beside the folder, if
    they are there. A test compares the documents with numbers.json, and that with the code.

    Args:
        out: folder to write to.
        keep_numbers: fill in the numbers.json that is there.
    """
    path = out / "numbers.json"
    results = json.loads(path.read_text()) if keep_numbers else numbers()
    path.write_text(json.dumps(results, indent=1) + "\n")
    for name in DOCUMENTS:
        if (page := out.parent / name).exists():
            page.write_text(filled(page.read_text(), results))
    for name, text in tables(results).items():
        print(f"\n{name}\n\n{text}")
    return 0


def numbers() -> dict[str, Any]:
    """Every number that the two documents quote."""
    return {
        "accuracy": accuracy.accuracy(count=10, grazes=400),
        "order": errata.orders(),
        "printed_impact": errata.printed_impact(),
        "motor_pole": {name: params.motor_pole for name, params in PRESETS.items()},
        "reach_and_hub": {name: errata.reach_and_hub(of) for name, of in PRESETS.items()},
        "kappa": {name: errata.kappa_range(of) for name, of in PRESETS.items()},
    }


Results = dict[str, Any]

#: The fields in which presets differ: symbol, what it is about, field, unit.
PARAMETERS = (
    ("$m_1$", "", "wheel_mass", "kg"),
    ("$I_1$", "about the hub", "wheel_inertia", "kg m²"),
    ("$L_1$", "", "leg_length", "m"),
    ("$n$", "", "n_legs", ""),
    ("$m_2$", "", "pendulum_mass", "kg"),
    ("$L_2$", "hub to centre of mass", "pendulum_length", "m"),
    ("$I_2$", "about its centre of mass", "pendulum_inertia", "kg m²"),
    ("", "hub to far end", "pendulum_reach", "m"),
    ("$K_m$", "", "motor_constant", "N m/A"),
    ("$N$", "", "gear_ratio", ""),
    ("$R_m$", "", "armature_resistance", "Ω"),
    ("$J_m$", "at the motor shaft", "rotor_inertia", "kg m²"),
    ("$F_0$", "dry friction", "hub_friction", "N m"),
    ("$c$", "share of the torque", "gear_loss", ""),
    ("$P_0$", "", "idle_power", "W"),
    ("$\\mu$", "of the ground", "friction", ""),
    ("$V$", "largest", "voltage_limit", "V"),
)


def parameters_table() -> str:
    """The presets' parameters, where they differ."""
    rows = []
    for symbol, about, field, unit in PARAMETERS:
        values = [getattr(params, field) for params in PRESETS.values()]
        if field == "pendulum_reach":
            values = [params.constants.reach for params in PRESETS.values()]
        meaning = ", ".join(part for part in (symbol, about) if part)
        name = f"`{field}` ({unit})" if unit else f"`{field}`"
        rows.append([meaning, name, *(f"{value:.4g}" for value in values)])
    return table(["symbol", "field of `WheelParams`", *(f"`{name}`" for name in PRESETS)], rows)


def derived_table(results: Results) -> str:
    """What follows from the presets' parameters."""
    head = ["", "motor pole (1/s)", "κ", "pendulum's reach (m)", "hub on two feet (m)"]
    rows = []
    for name in PRESETS:
        low, high = results["kappa"][name]
        reach, hub = results["reach_and_hub"][name]
        pole = f"{results['motor_pole'][name]:.1f}"
        rows.append([f"`{name}`", pole, f"{low:.2f} to {high:.2f}", f"{reach:.3f}", f"{hub:.3f}"])
    return table(head, rows)


def accuracy_table(results: Results) -> str:
    """The kernel against the reference simulator, with one figure for each preset."""
    head = ["case", "motions", "touchdowns", "state (rad, rad/s)", "start moved by 1e-13 rad"]
    rows = []
    for case in CASES:
        cells = [results["accuracy"][name][case] for name in PRESETS]
        counts = [sum(cell[key] for cell in cells) for key in ("motions", "touchdowns")]
        errors = [" / ".join(f"{cell[key]:.0e}" for cell in cells) for key in ("state", "nudged")]
        residual = f"{max(cell['residual'] for cell in cells):.0e}"
        disagreements = sum(cell["disagreements"] for cell in cells)
        rows.append([case, *counts, *errors, residual, disagreements])
    return table([*head, "ledger residual (J)", "disagree"], rows)


def typical_table(results: Results) -> str:
    """The printed impact beside the right one, where the pendulum does not turn."""
    head = ["θ (rad)", "rate, plastic", "rate, (3.82)", "energy, plastic", "energy, (3.82)"]
    columns = ("plastic_rate", "thesis_rate", "plastic_energy", "thesis_energy", "closed_form_rate")
    rows = [
        [f"{at['theta']:.1f}", *(f"{at[key]:.2f}" for key in columns)]
        for at in results["printed_impact"]["typical"]
    ]
    return table([*head, "rate, (3.85-3.87)"], rows)


def shares_table(results: Results) -> str:
    """How often the printed impact creates energy or reverses the wheel."""
    head = ["machine", "(3.82) creates energy", "(3.82) reverses the wheel"]
    keys = ("creates", "reverses", "closed_form_reverses")
    rows = [
        [name, *(f"{100 * of[key]:.0f} %" for key in keys), f"{of['largest']:.2f}"]
        for name, of in results["printed_impact"]["random"].items()
    ]
    return table([*head, "(3.85-3.87) reverses it", "largest gain of (3.82)"], rows)


def channels_table() -> str:
    """The ledger's energies."""
    side = {1: "in", -1: "out", 0: "beside it"}
    rows = [[f"`{name}`", side[sign], meaning] for name, sign, meaning in CHANNELS]
    return table(["energy (J)", "in the balance", ""], rows)


def tables(results: Results) -> dict[str, str]:
    """Every table by name."""
    return {
        "accuracy": accuracy_table(results),
        "typical": typical_table(results),
        "shares": shares_table(results),
        "channels": channels_table(),
        "parameters": parameters_table(),
        "derived": derived_table(results),
    }


def filled(page: str, results: Results) -> str:
    """A document with its tables, which are recognised by their heads, replaced by new ones."""
    for text in tables(results).values():
        head = re.escape(text.splitlines()[0])
        found = re.search(rf"^{head}\n(\|.*\n)*", page, flags=re.MULTILINE)
        page = page.replace(found[0], f"{text}\n") if found else page
    return page
