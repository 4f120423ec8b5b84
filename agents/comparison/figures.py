"""The plots and the HTML report of a comparison."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import matplotlib.pyplot as plt
import numpy as np

from agents.comparison.methods import LearnedMethod, Method
from agents.comparison.study import Setting
from agents.comparison.table import COLUMNS, FRONT_POLICY, NOTES, Row, distinct
from agents.comparison.walks import (
    deviation_charts,
    deviations,
    last_middle,
    return_chart,
    return_map,
    steps_of,
)
from agents.conditions import Conditions
from agents.experts import EXPERT
from agents.page import write_page
from agents.policies import Policy, controller_policy, law_title
from agents.policy_files import load_policy
from agents.reports import (
    Axis,
    Chart,
    Series,
    document,
    draw,
    embedded,
    paragraph,
    section,
    table,
)
from agents.rollout import Interval, Rollout, at_rest
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import machine_name
from trajopt.feedback import laws
from trajopt.feedback.law import Floats
from trajopt.gaits.fronts import CotFront, NoFrontError
from trajopt.gaits.solution import Solution
from trajopt.store import write_text

#: Policies with a smaller gap are in the plot of gaps.
NEAR = 0.1

#: Markers of policies with the same colour.
MARKERS = "osD^vP"

#: The abscissae of learning curves: entry of a milestone, label, scale, threshold.
ACROSS = (
    ("intervals", "control intervals of training", "symlog", 1e5),
    ("minutes", "minutes of one core, cloning included", "linear", 1.0),
)

#: Seconds of a walk that is plotted, and those at its end in which it is steady.
WALK, STEADY = 20.0, 10.0

#: Milestones of a training (`agents.training.Milestone`) as plain values, in order.
Curve: TypeAlias = Sequence[Mapping[str, Any]]

LEAD = (
    "Optimal gaits, feedback laws that hold them, and policies learned on the same model, all "
    "measured in the same way. The machine: {machine}. Click a heading to sort."
)

ABOUT_DEVIATIONS = (
    "The last 10 s of a walk from rest, step by step, less the environment's own optimum at the "
    "same share of the step's time. A walk that repeats the optimum lies on zero."
)

ABOUT_RETURNS = (
    "Small pushes, and the touchdowns after them. The steady walk is where a touchdown is like the "
    "one before. The multipliers are the factors by which small deviations grow in a step. A walk "
    "that drifts through the ticks of the control has one near 1. A multiplier whose direction "
    "turns has no slope."
)


def write_figures(
    setting: Setting,
    rows: Sequence[Row],
    methods: Sequence[Method],
    curves: Mapping[str, Curve],
) -> None:
    """Write the plots, report.html, and page.html where the machine has one, into the folder.

    Args:
        setting: of the comparison, whose results are complete.
        rows: of its table.
        methods: that were compared.
        curves: milestones of trainings, by their names.
    """
    out = setting.out
    walks = plotted_walks(setting, methods)
    drawn = {
        "cot_against_speed": draw(
            speed_charts(setting.front, setting.held_front, rows), 1, (9.0, 4.4), legends=True
        ),
        "learning_curves": draw(learning_charts(curves, setting.held_front), 2, (5.2, 3.2)),
        "deviations": draw(cycle_charts(walks), 4),
        "return_maps": draw(return_charts(setting.params, walks), 4),
    }
    images = {name: embedded(figure, name.replace("_", " ")) for name, figure in drawn.items()}
    for name, figure in drawn.items():
        figure.savefig(out / f"{name}.png", dpi=150)
        plt.close(figure)
    listed = [dataclasses.asdict(row) for row in distinct(rows)]
    parts = [
        section("Learned against optimal", table(COLUMNS, listed), paragraph(NOTES)),
        section("On the front", images["cot_against_speed"]),
        section("Beside the optimal cycle", paragraph(ABOUT_DEVIATIONS), images["deviations"]),
        section("From step to step", paragraph(ABOUT_RETURNS), images["return_maps"]),
        section("How they learned", images["learning_curves"]),
    ]
    lead = LEAD.format(machine=machine_name(setting.params))
    text = document("Learned against optimal walking", lead, parts, _page(out))
    write_text(out / "report.html", text)


def _page(folder: Path) -> str | None:
    """The page with the study's own clone, beside the report."""
    try:
        return write_page(folder / "page.html", folder / "imitation" / "clone.zip").name
    except NoFrontError:
        return None


def speed_charts(front: CotFront, held: CotFront, rows: Iterable[Row]) -> list[Chart]:
    """Cost of transport over speed of all that walk, and the gaps of those near to the optimum.

    Args:
        front: of optimal gaits with a continuous voltage.
        held: of gaits whose voltage is held, against which gaps are measured.
        rows: of the table. Optimal gaits on the fronts are left out.
    """
    shown = [
        row
        for row in rows
        if row.cot is not None
        and (row.walking_share or (row.walking_share is None and not _near(row)))
    ]
    optima = [
        Series(name, [g.speed for g in of.envelope], [g.cot for g in of.envelope], line=line)
        for name, of, line in (
            ("optimal, voltage continuous", front, "--"),
            ("optimal, voltage held", held, "-"),
        )
    ]
    ends = [gait.speed for gait in held.envelope]
    gaps = [
        Series("optimal, voltage continuous", *_gaps(front, held), line="--"),
        Series("optimal, voltage held", ends, np.zeros(len(ends))),
        *_points([row for row in shown if _near(row)], "gap", 100.0),
    ]
    costs = [*optima, *_points(shown, "cot", 1.0)]
    speed = Axis("speed (m/s)")
    return [
        Chart(
            "Cost of transport over speed (E+, no regeneration)", speed, Axis("CoT", "log"), costs
        ),
        Chart("Gaps of those near to the optimum", speed, Axis("gap (%)"), gaps),
    ]


def _near(row: Row) -> bool:
    return row.gap is not None and abs(row.gap) <= NEAR


def _points(rows: Sequence[Row], figure: str, scale: float) -> list[Series]:
    """A series for each title, in the colour of its kind; the policy for the front is a line."""
    series, used = [], dict[str, int]()
    for title in dict.fromkeys(row.title for row in rows):
        own = [row for row in rows if row.title == title]
        colour = "faint" if own[0].walking_share is None else colour_of_policy(title)
        marker = MARKERS[used.get(colour, 0) % len(MARKERS)]
        used[colour] = used.get(colour, 0) + 1
        x = np.array([row.speed for row in own], dtype=float)
        y = scale * np.array([getattr(row, figure) for row in own], dtype=float)
        line = "-" if title == FRONT_POLICY else "none"
        series.append(Series(title, x, y, colour=colour, line=line, width=1.0, marker=marker))
    return series


def colour_of_policy(title: str) -> str:
    """Laws, clones, fine-tuned policies and those from scratch have different colours."""
    kinds = {
        "orange": ("imitation", FRONT_POLICY),
        "blue": ("fine-tuned",),
        "ochre": ("PPO",),
        "violet": ("evolution",),
    }
    return next((c for c, starts in kinds.items() if title.startswith(starts)), "teal")


def _gaps(front: CotFront, held: CotFront) -> tuple[Floats, Floats]:
    """Speeds (m/s) of the gaits of one front that lie on the other, and their gaps to it (%)."""
    slowest, fastest = held.envelope[0].speed, held.envelope[-1].speed
    shared = [g for g in front.envelope if slowest - 1e-9 <= g.speed <= fastest + 1e-9]
    speeds = np.array([gait.speed for gait in shared])
    return speeds, 100.0 * (np.array([gait.cot for gait in shared]) / held(speeds) - 1.0)


def learning_charts(curves: Mapping[str, Curve], front: CotFront) -> list[Chart]:
    """The gap and the share of starts that walk, over control intervals and over minutes.

    A walk beyond the front's speeds is compared with the nearer end of the front, and is hollow.

    Args:
        curves: milestones of trainings, by their names.
        front: that gaps are measured against.
    """
    ordinates = (
        (Axis("gap to the optimum (%)", "symlog"), lambda each: milestone_gap(each, front)),
        (Axis("starts that walk (%)", limits=(-5.0, 105.0)), _share),
    )
    charts = []
    for y_axis, figure in ordinates:
        for entry, label, scale, threshold in ACROSS:
            series = [
                Series(
                    name,
                    [each[entry] for each in curve],
                    [figure(each) for each in curve],
                    colour=colour_of_policy(name),
                    marker="o",
                    hollow=tuple(i for i, each in enumerate(curve) if _beyond(each, front)),
                )
                for name, curve in curves.items()
            ]
            title = f"{y_axis.label.partition(' (')[0]}, over {entry} (hollow: not on the front)"
            charts.append(Chart(title, Axis(label, scale, threshold), y_axis, series))
    return charts


def milestone_gap(milestone: Mapping[str, Any], front: CotFront) -> float:
    """In per cent, at the front's speed nearest to that of the walk; NaN where none walks."""
    if not milestone["walking_share"]:
        return math.nan
    speeds = [gait.speed for gait in front.envelope]
    speed = min(max(milestone["speed"], speeds[0]), speeds[-1])
    return 100.0 * (float(milestone["cot"]) / float(front(speed)) - 1.0)


def _share(milestone: Mapping[str, Any]) -> float:
    return 100.0 * float(milestone["walking_share"])


def _beyond(milestone: Mapping[str, Any], front: CotFront) -> bool:
    """Whether it walks slower or faster than the front."""
    ends = front.envelope[0].speed, front.envelope[-1].speed
    return bool(milestone["walking_share"] and not ends[0] <= milestone["speed"] <= ends[1])


class PlottedWalk(NamedTuple):
    """A policy whose walk is plotted.

    Attributes:
        name: in the plots.
        policy: see `agents.policies`.
        walk: from rest, as long as `WALK`, or until it falls.
        optimum: the environment's best gait, nearest to the walk's speed.
        holds: whether the policy is to hold that gait; else it chose its speed itself.
    """

    name: str
    policy: Policy
    walk: list[Interval]
    optimum: Solution
    holds: bool


def plotted_walks(setting: Setting, methods: Sequence[Method]) -> list[PlottedWalk]:
    """The walks of the best law, its clone and the other policies that are plotted."""
    law = laws.design(EXPERT, setting.held_gait(setting.study.speed), setting.out)
    policies: list[tuple[str, Policy, float | None]] = [
        (law_title(EXPERT), controller_policy(setting.params, law), setting.study.speed)
    ]
    for method in methods:
        if isinstance(method, LearnedMethod) and method.walk:
            policy = load_policy(method.main_file(setting.out)).policy
            policies.append((method.walk, policy, method.speed))
    walks = []
    for name, policy, speed in policies:
        walk = list(walk_from_rest(setting.params, policy, WALK))
        gait = setting.held_gait(_speed(walk) if speed is None else speed)
        walks.append(PlottedWalk(name, policy, walk, gait, speed is not None))
    return walks


def walk_from_rest(params: WheelParams, policy: Policy, seconds: float) -> Rollout:
    """One walk of a policy."""
    n_intervals = round(seconds / CONTROL_PERIOD)
    return Rollout(Conditions(params), policy, at_rest(params)[None], n_intervals)


def _steady_part(walk: Sequence[Interval]) -> Sequence[Interval]:
    return walk[-round(STEADY / CONTROL_PERIOD) :]


def _speed(walk: Sequence[Interval]) -> float:
    """Over its last seconds (m/s)."""
    steady = _steady_part(walk)
    distance = sum(float(interval.info["distance"][0]) for interval in steady)
    return distance / (len(steady) * CONTROL_PERIOD)


def is_steady(walk: Sequence[Interval]) -> bool:
    """Whether a walk lasts for its whole time, and still takes steps at its end."""
    steps = sum(float(interval.info["steps"][0]) for interval in _steady_part(walk))
    whole = len(walk) == round(WALK / CONTROL_PERIOD)
    return whole and steps > 1 and last_middle(walk) is not None


def cycle_charts(walks: Sequence[PlottedWalk]) -> list[Chart]:
    """The deviations of steady walks from the optimum; walks beside one gait share their charts."""
    steady = [each for each in walks if is_steady(each.walk)]
    charts: list[Chart] = []
    for gait in {id(each.optimum): each.optimum for each in steady}.values():
        found = {
            each.name: (
                deviations(steps_of(_steady_part(each.walk)), gait),
                colour_of_policy(each.name),
            )
            for each in steady
            if each.optimum is gait
        }
        charts += deviation_charts(found, f"at {gait.speed:.2f} m/s")
    return charts


def return_charts(params: WheelParams, walks: Sequence[PlottedWalk]) -> list[Chart]:
    """The return maps of steady walks."""
    charts = []
    for each in walks:
        if is_steady(each.walk):
            free = float(abs(each.optimum.floquet[0])) if each.holds else None
            found = return_map(params, each.policy, each.walk)
            if found.spread > 0.0:
                charts.append(return_chart(each.name, found, colour_of_policy(each.name), free))
    return charts
