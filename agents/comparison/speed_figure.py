"""Cost of transport over speed: optimal gaits, and every policy by its name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from agents.comparison.labels import Named, write_names
from agents.comparison.shipped import TITLE
from agents.comparison.style import INK, NAMES, STYLE
from agents.reports.colours import LIGHT
from trajopt.feedback.law import Floats
from trajopt.gaits.fronts import CotFront

#: Policies with a larger gap are named in the upper plot, the others in the lower one.
NEAR = 0.1

#: Part of the speeds that is left free at the right, for names.
ROOM = 0.3

TICKS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)

Rows = Sequence[dict[str, Any]]


def plot_cot_against_speed(path: Path, front: CotFront, held: CotFront, rows: Rows) -> None:
    """Cost of transport of all that walk; and below, the gaps of those near to the optimum.

    Args:
        path: of the picture.
        front: of optimal gaits with a continuous voltage.
        held: of gaits whose voltage is held, against which gaps are measured.
        rows: of the table. Optimal gaits at the study's speeds are on the fronts already.
    """
    ends = [gait.speed for gait in (front.envelope[0], front.envelope[-1])]
    policies = [row for row in rows if row["walking_share"] and row["cot"] is not None]
    others = [row for row in rows if row["walking_share"] is None and not is_near(row)]
    speeds = [row["speed"] for row in (*policies, *others)] + ends
    span = max(speeds) - min(speeds) or 0.01
    with matplotlib.rc_context(STYLE):
        figure, (above, below) = plt.subplots(
            2, 1, figsize=(9.5, 8.5), sharex=True, height_ratios=(1, 1.5)
        )
        figure.subplots_adjust(left=0.09, right=0.98, top=0.98, bottom=0.07, hspace=0.06)
        below.set_xlim(min(speeds) - 0.04 * span, max(speeds) + ROOM * span)
        _plot_costs(above, front, held, [*policies, *others])
        _plot_gaps(below, front, held, [row for row in policies if is_near(row)])
        figure.savefig(path, dpi=150)
        plt.close(figure)


def is_near(row: Mapping[str, Any]) -> bool:
    """Whether its gap is small."""
    return row["gap"] is not None and abs(row["gap"]) <= NEAR


def colour_name(row: Mapping[str, Any]) -> str:
    """Colour of a row's point, a name in `agents.reports.colours`."""
    return "faint" if row["walking_share"] is None else colour_of_policy(row["policy"])


def colour_of_policy(name: str) -> str:
    """Laws, clones, fine-tuned and those from scratch are told apart."""
    kinds = (("imitation", TITLE), ("fine-tuned",), ("PPO",), ("evolution",))
    found = [k for k, kind in enumerate(kinds) if name.startswith(kind)]
    return NAMES[found[0] + 1] if found else NAMES[0]


def of_one_policy(row: Mapping[str, Any]) -> bool:
    """Whether it is of the policy that walks at every speed: its points are joined."""
    return bool(row["policy"] == TITLE)


def short_name(row: Mapping[str, Any]) -> str:
    """What stands beside its point."""
    return str(row["policy"]).removesuffix(" about the optimum")


def _colour(row: Mapping[str, Any]) -> str:
    return LIGHT[colour_name(row)]


def _colour_of_name(row: Mapping[str, Any]) -> str:
    return INK if row["walking_share"] is None else _colour(row)


def _mark(axes: Axes, rows: Rows, heights: Sequence[float]) -> None:
    """A point for each row; those of one policy that walks at several speeds are joined."""
    for row, y in zip(rows, heights, strict=True):
        axes.plot(row["speed"], y, "o", color=_colour(row), markersize=6, alpha=0.8, mew=0)
    joined = [(row, y) for row, y in zip(rows, heights, strict=True) if of_one_policy(row)]
    if joined:
        speeds, line = [row["speed"] for row, _ in joined], [y for _, y in joined]
        axes.plot(speeds, line, color=_colour(joined[0][0]), linewidth=1.0, alpha=0.8)


def _names(rows: Rows, heights: Sequence[float]) -> list[Named]:
    """Names beside the points. Of one policy at several speeds, only the last is named."""
    ones = [row["speed"] for row in rows if of_one_policy(row)]
    return [
        Named(row["speed"], y, short_name(row), _colour_of_name(row))
        for row, y in zip(rows, heights, strict=True)
        if not of_one_policy(row) or row["speed"] == max(ones)
    ]


def _plot_costs(axes: Axes, front: CotFront, held: CotFront, rows: Rows) -> None:
    for of, style in ((front, "--"), (held, "-")):
        axes.plot(
            [gait.speed for gait in of.envelope],
            [gait.cot for gait in of.envelope],
            style,
            color=INK,
            linewidth=1.5,
        )
    _mark(axes, rows, [row["cot"] for row in rows])
    costs = [row["cot"] for row in rows] + [
        gait.cot for gait in (*front.solutions, *held.solutions)
    ]
    axes.set(yscale="log", ylabel="cost of transport (E+, no regeneration)")
    axes.set_ylim(min(costs) / 1.3, max(costs) * 1.4)
    ticks = [tick for tick in TICKS if min(costs) / 1.3 <= tick <= max(costs) * 1.4]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    first = held.envelope[0]
    axes.annotate(
        "optimal gaits, and all that is shown below",
        (first.speed, first.cot),
        (0, 9),
        textcoords="offset points",
        fontsize=8,
    )
    far = [row for row in rows if not is_near(row)]
    write_names(axes, _names(far, [row["cot"] for row in far]))


def _plot_gaps(axes: Axes, front: CotFront, held: CotFront, rows: Rows) -> None:
    """Gaps in per cent."""
    speeds, free = shared_gaps(front, held)
    gaps = [100.0 * row["gap"] for row in rows]
    axes.plot([gait.speed for gait in held.envelope], np.zeros(len(held.envelope)), color=INK)
    axes.plot(speeds, free, "--", color=INK, linewidth=1.5)
    low, high = min([*free, *gaps, 0.0]), max([*gaps, 0.0])
    room = 0.15 * max(high - low, 0.1)
    axes.set_ylim(low - room, high + room)
    axes.set(xlabel="speed (m/s)", ylabel="gap to the optimum (%)")
    _mark(axes, rows, gaps)
    optima = [
        Named(speeds[-1], 0.0, "optimal, voltage held", INK),
        Named(speeds[-1], float(free[-1]), "optimal, voltage free", INK),
    ]
    write_names(axes, _names(rows, gaps) + optima)


def shared_gaps(front: CotFront, held: CotFront) -> tuple[Floats, Floats]:
    """Speeds (m/s) of one front's gaits that lie on the other, and their gaps to it (%)."""
    shared = [gait for gait in front.envelope if _on(held, gait.speed)]
    speeds = np.array([gait.speed for gait in shared])
    return speeds, 100.0 * (np.array([gait.cot for gait in shared]) / held(speeds) - 1.0)


def _on(front: CotFront, speed: float) -> bool:
    ends = front.envelope[0].speed, front.envelope[-1].speed
    return ends[0] - 1e-9 <= speed <= ends[1] + 1e-9
