"""How the figures of the comparison look."""

from __future__ import annotations

from typing import Any

INK, FAINT = "#26303b", "#8a97a6"
COLOURS = ("#0b8f83", "#e5562e", "#3b6fb6", "#b0892b", "#8459a8")

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
