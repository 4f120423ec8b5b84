"""The comparison's plots for a screen: cost over speed, gaps, learning curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.comparison.learning_curves import ACROSS, Curve, beyond, gap, share
from agents.comparison.speed_figure import (
    colour_name,
    is_near,
    of_one_policy,
    shared_gaps,
    short_name,
)
from agents.comparison.style import NAMES
from agents.reports.charts import Axis, Chart, Series
from trajopt.gaits.fronts import CotFront

SPEED = Axis("speed (m/s)")


def speed_charts(front: CotFront, held: CotFront, rows: Sequence[dict[str, Any]]) -> list[Chart]:
    """Cost of transport over speed of all that walk, and the gaps of those near to the optimum.

    Args:
        front: of optimal gaits with a continuous voltage.
        held: of gaits whose voltage is held, against which gaps are measured.
        rows: of the table.
    """
    walking = [row for row in rows if row["walking_share"] and row["cot"] is not None]
    others = [row for row in rows if row["walking_share"] is None and not is_near(row)]
    optima = [
        Series(name, [g.speed for g in of.envelope], [g.cot for g in of.envelope], line=line)
        for name, of, line in (
            ("optimal, voltage free", front, "dashed"),
            ("optimal, voltage held", held, "solid"),
        )
    ]
    costs = [*_points(walking, "cot", 1.0), *_points(others, "cot", 1.0)]
    speeds, free = shared_gaps(front, held)
    ends = [gait.speed for gait in held.envelope]
    gaps = [
        Series("optimal, voltage free", speeds, free, line="dashed"),
        Series("optimal, voltage held", ends, np.zeros(len(ends))),
        *_points([row for row in walking if is_near(row)], "gap", 100.0),
    ]
    return [
        Chart("Cost of transport over speed", SPEED, Axis("CoT", "log"), [*optima, *costs]),
        Chart("Gaps of those near to the optimum", SPEED, Axis("gap (%)"), gaps),
    ]


def _points(rows: Sequence[Mapping[str, Any]], figure: str, scale: float) -> list[Series]:
    """Gaits and policies. Near ones are named only beside their gaps, and found by hovering.

    Args:
        rows: of the table.
        figure: the column that is drawn.
        scale: factor on it.
    """
    alone = [[row] for row in rows if not of_one_policy(row)]
    joined = [row for row in rows if of_one_policy(row)]
    return [
        Series(
            short_name(group[0]),
            [row["speed"] for row in group],
            [scale * row[figure] for row in group],
            colour=colour_name(group[0]),
            line="solid" if len(group) > 1 else "none",
            marks=True,
            named=figure == "gap" or not is_near(group[0]),
        )
        for group in (*alone, *([joined] if joined else []))
    ]


def learning_charts(curves: Mapping[str, Curve], front: CotFront) -> list[Chart]:
    """The gap and the share of starts that walk, over control intervals and over minutes.

    Args:
        curves: milestones of trainings, by their names.
        front: that gaps are measured against.
    """
    figures = (
        (Axis("gap to the optimum (%)", "symlog"), lambda each: gap(each, front)),
        (Axis("starts that walk (%)", limits=(-5.0, 105.0)), share),
    )
    scales = {"intervals": ("symlog", 1e5), "minutes": ("linear", 1.0)}
    charts = []
    for axis, of in figures:
        for across, label in ACROSS.items():
            series = [
                Series(
                    name,
                    [each[across] for each in curve],
                    [of(each) for each in curve],
                    colour=colour,
                    marks=True,
                    hollow=tuple(i for i, each in enumerate(curve) if beyond(each, front)),
                )
                for (name, curve), colour in zip(curves.items(), NAMES[1:], strict=False)
            ]
            title = f"Learning: {axis.label.partition(' (')[0]}, over {across}"
            charts.append(Chart(title, Axis(label, *scales[across]), axis, series))
    return charts
