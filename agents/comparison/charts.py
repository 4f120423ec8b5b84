"""The comparison's plots for a screen: cost over speed, gaps, learning curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.comparison.learning_curves import ACROSS, Curve, beyond, gap, share
from agents.comparison.speed_figure import colour_name, is_near, shared_gaps, short_name
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
    costs = [_point(row, row["cot"], not is_near(row)) for row in (*walking, *others)]
    speeds, free = shared_gaps(front, held)
    ends = [gait.speed for gait in held.envelope]
    gaps = [
        Series("optimal, voltage free", speeds, free, line="dashed"),
        Series("optimal, voltage held", ends, np.zeros(len(ends))),
        *(_point(row, 100.0 * row["gap"], True) for row in walking if is_near(row)),
    ]
    return [
        Chart("Cost of transport over speed", SPEED, Axis("CoT", "log"), [*optima, *costs]),
        Chart("Gaps of those near to the optimum", SPEED, Axis("gap (%)"), gaps),
    ]


def _point(row: Mapping[str, Any], y: float, named: bool) -> Series:
    """A gait or policy; those that are not named are found by hovering."""
    return Series(
        short_name(row),
        [row["speed"]],
        [y],
        colour=colour_name(row),
        line="none",
        marks=True,
        named=named,
    )


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
