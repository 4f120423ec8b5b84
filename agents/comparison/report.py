"""The comparison's table: a row for each gait and policy."""

from __future__ import annotations

import math
from typing import Any

from agents.reports.tables import Column
from rimless_gym.envs.task import Task
from trajopt.gaits.solution import Solution

COLUMNS = (
    Column("policy", "policy"),
    Column("CoT", "cot", ".4f", "cost of transport: energy drawn per weight and distance"),
    Column("return (m/s)", "return", ".3f", "the environment's reward per second"),
    Column("speed (m/s)", "speed", ".3f"),
    Column("gap to the optimum", "gap", "+z.1%", "at the row's own speed"),
    Column("starts that walk", "walking_share", ".0%"),
    Column("friction demand", "friction_demand", ".2f", "the largest |Fx| / Fy"),
    Column("least Fy / weight", "min_normal_force_over_weight", ".2f"),
)

#: Below the table.
NOTES = """\
CoT counts the energy drawn from the battery, E+, electronics included; none is fed back. The return
is the environment's reward per second, the mean over all starts, those that fall included; of a
gait, that of walking on it for ever. The gap is to the environment's own optimum at the row's own
speed, interpolated: the best periodic gait whose voltage is held for 10 ms. The other optimal gaits
may change it at any time. At one speed there are all laws; at the others, for want of time, only
the best law and its clone (fine-tuned too with `--further-timesteps`). Evolution and PPO choose
their own speed. PPO from screened policies is trained for a quarter of an hour, so its policy comes
with the package, for the default machine. So does the one policy for the front, which is told the
speed to walk at, and walks at two speeds more. "Best kept" is the policy that walked most cheaply
and surely in the periodic evaluations; it is the clone itself where none was better. Gaits and
policies keep the same rules: a start walks if in the measured 30 s its foot is pressed down and
does not slip, and its pendulum does not touch the floor, where there is one. Friction demand is the
largest |Fx| / Fy of stance and touchdowns, least Fy the least normal force in weights; both are
those of all starts that still take steps at the end, so that they show why some do not count."""


def gait_row(name: str, gait: Solution, gap: float | None, at: float | None) -> dict[str, Any]:
    """The row of an optimal gait.

    Args:
        name: what the table calls it.
        gait: its figures.
        gap: to the environment's own optimum; None: it is not known.
        at: the study's speed that it belongs to (m/s).
    """
    v = gait.verification
    return {
        "policy": name,
        "at": at,
        "cot": gait.cot,
        "return": (Task().distance_weight - gait.cot) * gait.speed,
        "speed": gait.speed,
        "gap": gap,
        "friction_demand": max(v.max_friction_demand, v.max_impulse_friction_demand),
        "min_normal_force_over_weight": v.min_normal_force_over_weight,
        "walking_share": None,
    }


def policy_row(
    name: str, evaluation: dict[str, Any], gap: float | None, at: float | None
) -> dict[str, Any]:
    """The row of a policy, from its evaluation as plain values; see `gait_row`.

    Of a policy that chooses its speed itself, `at` is None.
    """
    return {
        "policy": name,
        "at": at,
        "cot": evaluation["cot"],
        "return": evaluation["objective"],
        "speed": evaluation["speed"],
        "gap": gap,
        "friction_demand": _largest_demand(evaluation),
        "min_normal_force_over_weight": evaluation["min_normal_force_over_weight"],
        "walking_share": evaluation["walking_share"],
    }


def _largest_demand(evaluation: dict[str, Any]) -> float | None:
    """Largest friction demand; None where no start takes steps, or where the foot lifts."""
    demands = evaluation["friction_demand"], evaluation["impulse_friction_demand"]
    return None if None in demands else max(demands)


def format_table(rows: list[dict[str, Any]]) -> str:
    """The comparison as a Markdown table. Rows that read alike are one."""
    headings = [column.heading for column in COLUMNS[1:]]
    lines = [
        f"| | {' | '.join(headings)} |",
        "|" + "---|" * len(COLUMNS),
    ]
    lines += ["| " + " | ".join(_cells(row)) + " |" for row in distinct(rows)]
    return "\n".join([*lines, "", NOTES])


def distinct(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows without those that read like an earlier one."""
    first: dict[tuple[str, ...], dict[str, Any]] = {}
    for row in rows:
        first.setdefault(_cells(row), row)
    return list(first.values())


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    return tuple(column.text(row) for column in COLUMNS)


def by_speed(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows in order of the speed that they belong to; then those that belong to none."""
    return sorted(rows, key=lambda row: math.inf if row["at"] is None else row["at"])
