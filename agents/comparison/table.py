"""The table of a comparison: a row for each gait and policy, and the few rows of the headline."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from agents.gaps import reward_rate
from agents.policy_files import NOTHING
from agents.reports import NONE, Column, value_text
from agents.rollout import draw_starts
from rimless_gym.equations import DOUBLE
from rimless_gym.kernel.stepping import MODE
from rimless_gym.params import WheelParams
from trajopt.gaits.solution import Solution

COLUMNS = (
    Column("policy", "title"),
    Column("CoT", "cot", ".4f", "cost of transport: energy drawn per weight and distance"),
    Column("over the least CoT", "over_least", "+z.1%", "that of the best gait at any speed"),
    Column("share of the best return", "return_share", ".0%", "of 20 s, start-up included"),
    Column("speed (m/s)", "speed", ".3f"),
    Column("gap at its speed", "gap", "+z.1%", "to the best gait of 1 to 3 steps at its speed"),
    Column("starts that walk", "walking_share", ".0%"),
    Column("friction demand", "friction_demand", ".2f", "the largest |Fx| / Fy"),
    Column("least Fy / weight", "min_normal_force_over_weight", ".2f"),
)

#: Below the table.
NOTES = """\
CoT counts the energy drawn from the battery, E+, electronics included; none is fed back. Returns
are those of 20 s from all starts, as a share of what the best gait returns that is walked from the
first moment to the last: from rest, nothing can. The last rows have what the best of all policies
and laws attains from each start; the best attainable lies between that and 100%. The adaptive
controller walks from the first 8 starts, 3 of them at rest, and is not among these. The
environment's own optimum is the best periodic gait of 1 to 3 steps per stride whose voltage is held
for 10 ms: for the second column at any speed, for the gap at the row's own speed, interpolated.
Longer strides can cost less below 0.6 m/s. The other optimal gaits may change their voltage at any
time. At one speed there are all laws but `receding_horizon` and `tuned`, which take long, and a
clone of the best one. Evolution, PPO and fine-tuning choose their own speed, and the one policy for
the front walks at commanded speeds. Friction demand is the largest |Fx| / Fy of stance and
touchdowns, least Fy the least normal force in weights; both are of all starts that still take steps
at the end."""

#: Titles of rows.
FRONT_POLICY, PPO_PRIOR = "one policy for the front", "PPO with the law as prior, then CMA-ES"
SAC_PRIOR = "SAC with the law as prior, distilled, then CMA-ES"
DISTILLED = "evolution with a start-up controller, distilled"
EVOLVED = f"{DISTILLED}, then CMA-ES"
FRONT_TUNED = "imitation of a gain schedule, then CMA-ES"
ADAPTIVE = "adaptive controller (8 starts)"
REST, SAC_SCRATCH = "rest", "SAC from scratch"

#: Columns of the headline, after the name of a policy.
HEADINGS = (
    *("prior used", "cost of transport over the least at any speed"),
    *("share of the best 20 s return", "starts that walk", "environment steps"),
    *("minutes of one core", "cost over the least, several seeds"),
)

#: Rows of the headline: their titles, and what they are for somebody who reads nothing else, with
#: the names by which `rimless watch` and `load_policy` know them.
HEADLINE = {
    REST: "rest: no voltage",
    "optimal at any speed": "optimal gait at its best speed",
    "optimal, voltage held for 10 ms": "optimal gait (`optimum`)",
    "LQR about the optimum": "feedback law that holds it (`lqr`)",
    ADAPTIVE: "controller that identifies its machine (`adaptive`, 8 starts)",
    "imitation": "network cloned from the law (`imitation`)",
    "fine-tuned by CMA-ES": "clone fine-tuned by CMA-ES (`fine_tuned`)",
    FRONT_POLICY: "one network for commands of 0.5 to 0.63 m/s (`front`)",
    "evolution from scratch": "evolution from nothing (`evolution`)",
    EVOLVED: "evolution; a planned start-up; a network cloned from both; CMA-ES (`evolved`)",
    PPO_PRIOR: "PPO, a law as prior of reward and starts; then CMA-ES (`ppo`)",
    SAC_PRIOR: "SAC, the same prior; a network cloned from it; then CMA-ES (`sac`)",
    "PPO from scratch": "PPO from nothing, default settings",
    SAC_SCRATCH: "SAC from nothing, default settings",
}


@dataclasses.dataclass(frozen=True)
class Row:
    """A gait or a policy. Figures are None where they do not exist."""

    title: str  # its name in the table
    # the study's speed that it belongs to (m/s); None if it chooses its speed
    study_speed: float | None = None
    cot: float | None = None  # cost of transport
    objective: float | None = None  # mean reward per second (m/s)
    speed: float | None = None  # m/s
    gap: float | None = None  # to the environment's optimum of 1 to 3 steps at its speed
    walking_share: float | None = None  # of the starts; None for a gait
    friction_demand: float | None = None  # largest |Fx| / Fy of stance and touchdowns
    min_normal_force_over_weight: float | None = None  # least normal force in weights
    over_least: float | None = None  # gap to the environment's optimum at any speed
    # of 20 s, start-up included, over that of the best gait walked for all 20 s
    return_share: float | None = None
    # prior, intervals, minutes: see `agents.policy_files.TrainingEffort`
    prior: str | None = None
    intervals: int | None = None
    minutes: float | None = None

    @property
    def cells(self) -> tuple[str, ...]:
        """The texts of its line in the table."""
        return tuple(column.text(vars(self)) for column in COLUMNS)


def gait_row(title: str, gait: Solution, gap: float | None, study_speed: float | None) -> Row:
    """The row of an optimal gait; see `Row`."""
    v = gait.verification
    return Row(
        title,
        study_speed,
        gait.cot,
        reward_rate(gait),
        gait.speed,
        gap,
        None,
        max(v.max_friction_demand, v.max_impulse_friction_demand),
        v.min_normal_force_over_weight,
    )


def policy_row(
    title: str, evaluation: Mapping[str, Any], gap: float | None, study_speed: float | None
) -> Row:
    """The row of a policy, from its evaluation as plain values; see `Row`."""
    demands = evaluation["friction_demand"], evaluation["impulse_friction_demand"]
    return Row(
        title,
        study_speed,
        evaluation["cot"],
        evaluation["objective"],
        evaluation["speed"],
        gap,
        evaluation["walking_share"],
        None if None in demands else max(demands),  # none where no start takes steps
        evaluation["min_normal_force_over_weight"],
    )


def attained_rows(
    evaluations: Sequence[Mapping[str, Any]], params: WheelParams, best: float
) -> list[Row]:
    """From each start the greatest return of all evaluations, over `best` (m), by kind of start."""
    returns = np.max([evaluation["returns"] for evaluation in evaluations], axis=0)
    by = evaluations[0]["protocol"]
    rests = draw_starts(params, by["starts"], by["seed"])[:, MODE] == DOUBLE
    return [
        Row(
            f"the best of these from each start {how}",
            return_share=float(returns[some].mean()) / best,
        )
        for how, some in (("at rest", rests), ("in motion", ~rests))
        if some.any()
    ]


def by_speed(rows: Iterable[Row]) -> list[Row]:
    """The rows in order of the speed that they belong to; then those that belong to none."""
    return sorted(rows, key=lambda row: math.inf if row.study_speed is None else row.study_speed)


def distinct(rows: Iterable[Row]) -> list[Row]:
    """The rows without those whose texts are those of an earlier one."""
    first: dict[tuple[str, ...], Row] = {}
    for row in rows:
        first.setdefault(row.cells, row)
    return list(first.values())


def format_table(rows: Iterable[Row]) -> str:
    """The comparison as a Markdown table. Rows with the same texts are one."""
    headings = [column.heading for column in COLUMNS[1:]]
    lines = [f"| | {' | '.join(headings)} |", "|" + "---|" * len(COLUMNS)]
    lines += ["| " + " | ".join(row.cells) + " |" for row in distinct(rows)]
    return "\n".join([*lines, "", NOTES])


def headline(rows: Sequence[Row], study_speed: float, over_seeds: Mapping[str, str]) -> str:
    """A Markdown table of the rows in `HEADLINE` at the study's speed (m/s).

    `over_seeds` is what is known of such policies over many seeds, by title; of SAC from scratch,
    which takes too long for the comparison, nothing else is.
    """
    known = {row.title: row for row in rows if row.study_speed in (study_speed, None)}
    shown = [
        (meaning, known.get(title, Row(title, prior=NOTHING)), over_seeds.get(title, NONE))
        for title, meaning in HEADLINE.items()
        if title in known or title == SAC_SCRATCH
    ]
    return headline_table(shown)


def headline_table(shown: Sequence[tuple[str, Row, str]]) -> str:
    """A Markdown table in the columns of the headline: names, rows, and gaps over many seeds."""
    lines = [f"| | {' | '.join(HEADINGS)} |", "|---" * (1 + len(HEADINGS)) + "|"]
    for name, row, over_seeds in shown:
        millions = None if row.intervals is None else row.intervals / 1e6
        cells = (
            name,
            row.prior or NONE,
            value_text(row.over_least, "+z.1%"),
            value_text(row.return_share, ".0%"),
            value_text(row.walking_share, ".0%"),
            value_text(millions, ".3g") + " M" * (millions is not None),
            value_text(row.minutes, ".1f"),
            over_seeds,
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)
