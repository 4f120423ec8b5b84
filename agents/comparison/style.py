"""How the figures of the comparison look."""

from __future__ import annotations

from typing import Any

from agents.reports.colours import LIGHT

#: Colours of policies, by their names.
NAMES = ("teal", "orange", "blue", "ochre", "violet")

INK, FAINT = LIGHT["ink"], LIGHT["faint"]
COLOURS = tuple(LIGHT[name] for name in NAMES)

STYLE: Any = {  # matplotlib types its keys one by one
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.grid": True,
    "grid.color": "#e6eaef",
}
