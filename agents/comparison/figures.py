"""The plots and the HTML report of a comparison."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from agents.comparison.methods import LearnedMethod, Method
from agents.comparison.study import Setting
from agents.comparison.table import COLUMNS, FRONT_POLICY, NOTES, Row, distinct
from agents.comparison.walks import (
    ReturnMap,
    deviations,
    last_middle,
    multipliers_text,
    return_map,
    steps_of,
)
from agents.conditions import Conditions
from agents.experts import EXPERT
from agents.page import write_page
from agents.policies import Policy, controller_policy, law_title
from agents.policy_files import load_policy
from agents.reports import COLOURS, STYLE, document, embedded, paragraph, section, table
from agents.rollout import Interval, Rollout, at_rest
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import machine_name
from trajopt.feedback import laws
from trajopt.gaits.fronts import CotFront, NoFrontError
from trajopt.gaits.solution import Solution
from trajopt.store import write_text

#: Policies with a smaller gap are in the plot of gaps.
NEAR = 0.1

#: Markers of policies with the same colour.
MARKERS = "osD^vP"

#: The abscissae of learning curves: entries of a milestone, and their labels.
ACROSS = {
    "intervals": "control intervals of training",
    "minutes": "minutes of one core, cloning included",
}

#: The coordinates of the plots of deviations, and their units.
COORDINATES = {
    "leg angle phi": "mrad",
    "pendulum angle theta": "mrad",
    "leg rate phi'": "mrad/s",
    "pendulum rate theta'": "mrad/s",
}

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
    with matplotlib.rc_context(STYLE):
        drawn = {
            "cot_against_speed": speed_figure(setting.front, setting.held_front, rows),
            "learning_curves": learning_figure(curves, setting.held_front),
            "deviations": cycle_figure(walks),
            "return_maps": return_figure(setting.params, walks),
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


def speed_figure(front: CotFront, held: CotFront, rows: Iterable[Row]) -> Figure:
    """Cost of transport over speed of all that walk, and the gaps of those near to the optimum.

    Args:
        front: of optimal gaits with a continuous voltage.
        held: of gaits whose voltage is held, against which gaps are measured.
        rows: of the table. Optimal gaits on the fronts are left out.
    """
    figure, (above, below) = plt.subplots(
        2, 1, figsize=(9.0, 8.8), sharex=True, layout="constrained"
    )
    slowest, fastest = held.envelope[0].speed, held.envelope[-1].speed
    for of, line, name in ((front, "--", "continuous"), (held, "-", "held")):
        speeds = np.array([gait.speed for gait in of.envelope])
        cots = np.array([gait.cot for gait in of.envelope])
        shared = (slowest - 1e-9 <= speeds) & (speeds <= fastest + 1e-9)
        gaps = 100.0 * (cots[shared] / held(speeds[shared]) - 1.0)
        name = f"optimal, voltage {name}"
        above.plot(speeds, cots, line, color=COLOURS["ink"], label=name)
        below.plot(speeds[shared], gaps, line, color=COLOURS["ink"], label=name)
    walking = [row for row in rows if row.walking_share and row.cot is not None]
    gaits = [row for row in rows if row.walking_share is None and not _near(row)]
    _plot_rows(above, [*walking, *gaits], "cot", 1.0)
    _plot_rows(below, list(filter(_near, walking)), "gap", 100.0)
    above.set(yscale="log", ylabel="cost of transport (E+, no regeneration)")
    above.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    above.yaxis.set_major_formatter("{x:g}")
    above.minorticks_off()
    below.set(xlabel="speed (m/s)", ylabel="gap to the optimum (%)")
    for axes in (above, below):
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _near(row: Row) -> bool:
    return row.gap is not None and abs(row.gap) <= NEAR


def _plot_rows(axes: Axes, rows: Sequence[Row], column: str, scale: float) -> None:
    """Points for each title, in the colour of its kind; the policy for the front is a line."""
    used: list[str] = []
    for title in dict.fromkeys(row.title for row in rows):
        own = [row for row in rows if row.title == title]
        colour = "faint" if own[0].walking_share is None else colour_of_policy(title)
        axes.plot(
            np.array([row.speed for row in own], dtype=float),
            scale * np.array([getattr(row, column) for row in own], dtype=float),
            linestyle="-" if title == FRONT_POLICY else "none",
            linewidth=1.0,
            marker=MARKERS[used.count(colour) % len(MARKERS)],
            color=COLOURS[colour],
            label=title,
        )
        used.append(colour)


def colour_of_policy(title: str) -> str:
    """Laws, clones, fine-tuned policies and those from scratch have different colours."""
    kinds = {
        "orange": ("imitation", FRONT_POLICY),
        "blue": ("fine-tuned",),
        "ochre": ("PPO",),
        "violet": ("evolution",),
    }
    return next((c for c, starts in kinds.items() if title.startswith(starts)), "teal")


def learning_figure(curves: Mapping[str, Curve], front: CotFront) -> Figure:
    """The gap and the share of starts that walk, over control intervals and over minutes.

    A walk beyond the front's speeds is compared with the nearer end of the front, and is hollow.

    Args:
        curves: milestones of trainings, by their names.
        front: that gaps are measured against.
    """
    figure, panels = plt.subplots(
        2, 2, figsize=(10.4, 6.4), sharex="col", sharey="row", layout="constrained"
    )
    for name, curve in curves.items():
        colour = COLOURS[colour_of_policy(name)]
        faces = ["white" if _beyond(each, front) else colour for each in curve]
        gaps = [milestone_gap(each, front) for each in curve]
        shares = [100.0 * float(each["walking_share"]) for each in curve]
        for row, values in zip(panels, (gaps, shares), strict=True):
            for axes, across in zip(row, ACROSS, strict=True):
                x = [each[across] for each in curve]
                axes.plot(x, values, color=colour, label=name)
                axes.scatter(x, values, 20.0, faces, edgecolors=colour, zorder=3)
    for axes, label in zip(panels[1], ACROSS.values(), strict=True):
        axes.set_xlabel(label)
    panels[0, 0].set_xscale("symlog", linthresh=1e5)
    panels[0, 0].set_yscale("symlog")
    panels[0, 0].yaxis.set_major_formatter("{x:g}")
    panels[0, 0].set_ylabel("gap to the optimum (%); hollow: beyond the front")
    panels[1, 0].set(ylabel="starts that walk (%)", ylim=(-5.0, 105.0))
    _add_legend(figure)
    return figure


def _add_legend(figure: Figure) -> None:
    """One legend for all axes."""
    named: dict[str, Any] = {}
    for axes in figure.axes:
        handles, names = axes.get_legend_handles_labels()
        named |= dict(zip(names, handles, strict=True))
    if len(named) > 1:
        figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=5)


def milestone_gap(milestone: Mapping[str, Any], front: CotFront) -> float:
    """In per cent, at the front's speed nearest to that of the walk; NaN where none walks."""
    if not milestone["walking_share"]:
        return math.nan
    speeds = [gait.speed for gait in front.envelope]
    speed = min(max(milestone["speed"], speeds[0]), speeds[-1])
    return 100.0 * (float(milestone["cot"]) / float(front(speed)) - 1.0)


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


def cycle_figure(walks: Sequence[PlottedWalk]) -> Figure:
    """The deviations of steady walks from the optimum; walks beside one gait share a row."""
    steady = [each for each in walks if is_steady(each.walk)]
    gaits = list({id(each.optimum): each.optimum for each in steady}.values())
    down = max(1, len(gaits))
    figure, panels = plt.subplots(
        down, 4, figsize=(13.6, 2.8 * down), squeeze=False, layout="constrained"
    )
    for gait, row in zip(gaits, panels, strict=False):
        for each in (each for each in steady if each.optimum is gait):
            steps = deviations(steps_of(_steady_part(each.walk)), gait)
            phases = np.concatenate([np.append(step.phases, np.nan) for step in steps])
            states = np.concatenate([[*step.states, np.full(4, np.nan)] for step in steps])
            for axes, values in zip(row, 1e3 * states.T, strict=True):
                colour = COLOURS[colour_of_policy(each.name)]
                axes.plot(phases, values, color=colour, linewidth=1.0, label=each.name)
        for axes, (name, unit) in zip(row, COORDINATES.items(), strict=True):
            axes.set(title=f"{name}, at {gait.speed:.2f} m/s", xlabel="share of the step")
            axes.set_ylabel(f"deviation ({unit})")
    _add_legend(figure)
    return figure


def return_figure(params: WheelParams, walks: Sequence[PlottedWalk]) -> Figure:
    """The return maps of steady walks."""
    steady = [each for each in walks if is_steady(each.walk)]
    across = max(1, len(steady))
    figure, panels = plt.subplots(
        1, across, figsize=(3.4 * across, 3.2), squeeze=False, layout="constrained"
    )
    for each, axes in zip(steady, panels[0], strict=False):
        free = float(abs(each.optimum.floquet[0])) if each.holds else None
        returns = return_map(params, each.policy, each.walk)
        if returns.spread > 0.0:
            plot_return_map(axes, each.name, returns, free)
    _add_legend(figure)
    return figure


def plot_return_map(axes: Axes, name: str, returns: ReturnMap, free: float | None = None) -> None:
    """A return map with the diagonal, the steady walk, and the slopes of the first multipliers.

    Args:
        axes: to plot into.
        name: of the policy.
        returns: its return map, with a spread.
        free: the gait's largest Floquet multiplier without feedback, if it holds a gait.
    """
    steady, reach = returns.steady, 1.05 * returns.spread
    first = (returns.multipliers or [])[:2]
    lines = [("unchanged", 1.0, "--", "faint")]
    lines += [("slope of a multiplier", each.sign * each.size, "-", "ink") for each in first]
    if free is not None:
        lines.append((f"slope {free:.1f}, without feedback", free, "--", "ink"))
    for title, slope, line, colour in lines:
        if slope:
            x = np.array([-reach, reach]) / max(1.0, abs(slope))
            axes.plot(steady + x, steady + slope * x, line, color=COLOURS[colour], label=title)
    before, after = returns.rates[:, :-1].ravel(), returns.rates[:, 1:].ravel()
    axes.plot(before, after, "o", color=COLOURS[colour_of_policy(name)], markersize=2.0, label=name)
    axes.plot(steady, steady, "o", color=COLOURS["ink"], label="steady walk")
    limits = steady - reach, steady + reach
    axes.set(
        title=f"{name}: {multipliers_text(first)}" if first else name, xlim=limits, ylim=limits
    )
    axes.set(xlabel="leg rate at a touchdown (rad/s)", ylabel="at the next one (rad/s)")
