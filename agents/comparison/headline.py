"""The headline: the rows of a comparison that say most, in few columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agents.comparison.shipped import SCREENED, TITLE
from agents.reports.tables import NONE, figure

#: Titles of rows of the comparison, and what they are for somebody who reads nothing else, with the
#: names by which `rimless watch` and `load_policy` know them.
SHOWN = {
    "optimal, voltage held for 10 ms": "optimal gait (`optimum`)",
    "LQR about the optimum": "feedback law that holds it (`lqr`)",
    "imitation": "network cloned from the law (`imitation`)",
    "fine-tuned, best kept": "clone fine-tuned by PPO (`fine_tuned`)",
    TITLE: "one network that walks at the speed it is told (`front`)",
    "evolution from scratch": "evolution from nothing (`evolution`)",
    SCREENED: "PPO that goes on from the best of random policies (`screened_ppo`)",
    "PPO from scratch": "PPO from nothing (`ppo`)",
}


def headline(rows: list[dict[str, Any]], speed: float, over_seeds: Mapping[str, str]) -> str:
    """A Markdown table of the rows in `SHOWN`.

    Args:
        rows: of the comparison (`agents.comparison.report`).
        speed: of the study (m/s); rows that belong to its other speeds are left out.
        over_seeds: title of a row -> what is known of such policies over many seeds.
    """
    head = (
        *("", "cost of transport", "over the optimum at its speed", "speed (m/s)"),
        *("starts that walk", "the same with ten seeds"),
    )
    lines = ["| " + " | ".join(head).lstrip() + " |", "|---" * len(head) + "|"]
    for title, meaning in SHOWN.items():
        for row in rows:
            if row["policy"] == title and row["at"] in (speed, None):
                lines.append(_line(meaning, row, over_seeds.get(title, NONE)))
    return "\n".join(lines)


def _line(meaning: str, row: dict[str, Any], over_seeds: str) -> str:
    cells = (
        meaning,
        figure(row["cot"], ".4f"),
        figure(row["gap"], "+z.1%"),
        figure(row["speed"], ".3f"),
        figure(row["walking_share"], ".0%"),
        over_seeds,
    )
    return "| " + " | ".join(cells) + " |"
