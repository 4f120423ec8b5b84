"""The study's results as tables and figures, for docs/machine.md."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rimless_gym.presets import BUILDABLE
from scripts.studies.codesign import figures
from scripts.studies.codesign.budget import TOTAL_MASS, Build
from scripts.studies.codesign.parts import GPX_22_UP
from scripts.studies.codesign.problem import chosen
from scripts.studies.codesign.startup import figures as figures_of
from scripts.studies.documents.markdown import table
from trajopt.gaits.solution import Solution

TABLES = ("budget", "finals", "families", "preset", "comparison")
MARKS = {
    name: re.compile(rf"(<!-- codesign: {name} -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
    for name in TABLES
}

#: What a page must contain, in words.
WANTED = ", ".join(f"<!-- codesign: {n} --> and <!-- end of {n} -->" for n in TABLES)

#: Total cost of transport of walkers, as published.
OTHERS = (
    ("Cornell Ranger at its best, all its power (its 65 km cost 0.28)", 0.19),
    ("RR2 at its best, all its power", 0.13),
    ("a human, metabolic, at the cheapest speed", 0.3),
)


def row(found: Solution | str) -> dict[str, Any]:
    """A gait's figures, or the reason why there is none."""
    return {"reason": found} if isinstance(found, str) else figures_of(found)


def draw(found: Mapping[str, Any], folder: Path) -> None:
    """Write ``machine_landscape.png`` and ``machine_pendulum.png`` into a folder."""
    landscape = [each for each in found["landscape"].values() if "cot" in each]
    figures.landscape(landscape).savefig(folder / "machine_landscape.png", dpi=90)
    pendulums = list(found["pendulums"].values())
    figures.pendulums(pendulums).savefig(folder / "machine_pendulum.png", dpi=90)


def refresh(page: Path, found: Mapping[str, Any]) -> None:
    """Put every table between its marks."""
    text = page.read_text()
    for name, text_of in tables(found).items():
        text = MARKS[name].sub(partial(_between, text_of), text)
    page.write_text(text)


def _between(table: str, marks: re.Match[str]) -> str:
    return marks[1] + table + marks[2]


def tables(found: Mapping[str, Any]) -> dict[str, str]:
    """All tables by name."""
    made = {
        "budget": _budget(),
        "finals": _rows(_by_cost(found["finals"]), _FINAL),
        "families": _families(found["families"]),
        "preset": _rows(found["preset"], _PRESET),
        "comparison": _comparison(found["preset"]),
    }
    return {name: "\n".join(lines) + "\n" for name, lines in made.items()}


_PRESET = {
    "speed": "{speed:.3f}",
    "CoT": "{cot:.4f}",
    "open-loop multiplier": "{multiplier:.1f}",
    "friction demand": "{friction_demand:.2f}",
    "least Fy / weight": "{normal_force:.2f}",
    "peak torque (N m)": "{peak_torque:.2f}",
    "motor speed (rad/s)": "{motor_speed:.0f}",
    "in the gait within 10 s": "{joined:.0%}",
    "walking at the end": "{walking:.0%}",
    "their CoT": "{cot_of_walks:.4f}",
}
_FINAL = {
    "legs": "{legs}",
    "gear": "{ratio:.0f}",
    "bob (kg)": "{bob:.2f}",
    "arm (m)": "{arm:.3f}",
} | {key: value for key, value in _PRESET.items() if key != "their CoT"}


def _by_cost(rows: Mapping[str, Any]) -> dict[str, Any]:
    return dict(sorted(rows.items(), key=lambda item: float(item[1]["cot"])))


def _rows(rows: Mapping[str, Any], columns: Mapping[str, str]) -> list[str]:
    cells = [
        [
            "-" if "cot_of_walks" in cell and each["cot_of_walks"] is None else cell.format(**each)
            for cell in columns.values()
        ]
        for each in rows.values()
    ]
    return [table(list(columns), cells)]


def _families(rows: Mapping[str, Any]) -> list[str]:
    lines = [
        [key.replace("_", " "), f"{each['cot']:.4f}", f"{each['speed']:.2f}"]
        if "cot" in each
        else [key.replace("_", " "), "none found", "-"]
        for key, each in rows.items()
    ]
    return [table(["legs and gear, turns per step", "CoT", "speed (m/s)"], lines)]


def _budget() -> list[str]:
    gear = min(GPX_22_UP, key=lambda g: abs(g.ratio - BUILDABLE.gear_ratio))
    build, (bob, arm) = Build(gear, BUILDABLE.n_legs), chosen(BUILDABLE)
    parts = {name: mass for name, (mass, _) in build.wheel_parts().items()}
    parts["bob: steel bar"] = bob
    parts[f"arm of {1000 * arm:.0f} mm and its clamp"] = BUILDABLE.pendulum_mass - bob
    parts["left for payload, at the hub"] = TOTAL_MASS - sum(parts.values())
    lines = ["| part | mass (g) |", "| --- | --- |"]
    lines += [f"| {name} | {1000 * mass:.0f} |" for name, mass in parts.items()]
    return [*lines, f"| **sum** | **{1000 * sum(parts.values()):.0f}** |"]


def _comparison(rows: Mapping[str, Any]) -> list[str]:
    lines = ["| walker | total cost of transport |", "| --- | --- |"]
    best = min(rows.values(), key=lambda each: float(each["cot"]))
    own = [f"BUILDABLE, optimal gait at {best['speed']:.3f} m/s (a model)", best["cot"]]
    lines.append(f"| {own[0]} | {own[1]:.3f} |")
    steady: Sequence[Any] = [r for r in rows.values() if r["joined"] > 0.95]
    if steady:
        held = min(steady, key=lambda each: float(each["cot_of_walks"]))
        lines.append(
            f"| BUILDABLE under the LQR at 100 Hz, for the gait of {held['speed']:.3f} m/s "
            f"(a model) | {held['cot_of_walks']:.3f} |"
        )
    return lines + [f"| {name} | {cot:.2f} |" for name, cot in OTHERS]
