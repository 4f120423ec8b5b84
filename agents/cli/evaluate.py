"""Measure policies and feedback laws: 128 fixed starts, 50 s, the last 30 s of those that walk.

A start walks if it still takes steps at the end, and if in the last 30 s its foot is pressed down
and does not slip, and its pendulum does not touch the floor. The gap is to the best periodic gait
of 1 to 3 steps per stride, its voltage held for 10 ms, at the walked speed. With --seeds the
policies are those of several seeds of one training: below them stand the interquartile mean and its
95 % bootstrap interval.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.cli.commandline import (
    DISTURBANCES,
    RANGES,
    Parser,
    json_object,
    more_than_zero,
    whole,
)
from agents.commanded import STEP, commands_within
from agents.conditions import Conditions
from agents.evaluate import evaluate
from agents.gaps import gap_to_optimum
from agents.policy_files import PRETRAINED
from agents.statistics import bootstrap_interval, interquartile_mean
from agents.walkers import Walker, walker
from rimless_gym.envs.arguments import as_speeds
from rimless_gym.envs.disturbances import as_disturbances, as_ranges
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from trajopt import Solution, periodic_gait
from trajopt.feedback import laws
from trajopt.gaits.library import shipped
from trajopt.provenance import provenance

COLUMNS = (
    ("walking_share", "walking"),
    ("speed", "speed m/s"),
    ("cot", "CoT"),
    ("cot_with_regeneration", "CoT regen."),
    ("gap", "gap"),
    ("friction_demand", "friction"),
    ("impulse_friction_demand", "at touchdown"),
    ("min_normal_force_over_weight", "least Fy/weight"),
    ("min_clearance", "clearance m"),
    ("steps_per_period", "steps/period"),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = Parser(__doc__)
    parser.add_argument(
        "policies",
        nargs="+",
        metavar="POLICY",
        help=f"a policy's file (.zip); one that comes with the package: {', '.join(PRETRAINED)}; "
        f"or a feedback law: {', '.join(laws.names())}",
    )
    parser.add_argument("--gait", type=Path, help="file of the gait that laws hold (.npz)")
    parser.add_argument(
        "--speed", type=more_than_zero, default=0.5, help="of the gait that laws hold (m/s)"
    )
    parser.add_argument(
        "--steps", type=whole(1), default=1, help="per stride, of the gait that laws hold"
    )
    parser.add_argument(
        "--commands",
        type=more_than_zero,
        nargs="+",
        metavar="SPEED",
        help="at which policies walk that are commanded a speed (m/s); by "
        f"default every {STEP:g} m/s in the range that they were trained for",
    )
    parser.add_argument(
        "--gap",
        action=argparse.BooleanOptionalAction,
        help="solve the best gaits near the walked speed, and print the gap to them; by default "
        "where gaits of the machine are shipped, since elsewhere it takes minutes",
    )
    parser.add_trust()
    parser.add_argument(
        "--seeds", action="store_true", help="the policies are seeds of one training: summarise"
    )
    parser.add_argument("--json", action="store_true", help="everything, as JSON")
    parser.add_machine(
        None, "machine that the policies must be for; by default the one each was trained on"
    )
    parser.add_argument("--ranges", type=json_object(as_ranges), help=RANGES)
    parser.add_argument("--disturbances", type=json_object(as_disturbances), help=DISTURBANCES)
    options = parser.parse_args(arguments)
    params = parser.machine(options) if options.preset or options.params else None
    with parser.refusing():  # all of them, before the first is measured
        walkers = [w for name in options.policies for w in walkers_of(name, params, options)]
        commanded = any(w.command is not None for w in walkers)
        if options.seeds and commanded:
            parser.error("--seeds: policies that are commanded a speed are not summarised")
        if options.commands and not commanded:
            parser.error("--commands: none of these policies is commanded a speed")
        if options.commands:
            as_speeds("--commands", options.commands, len(options.commands))
        conditions = {"ranges": options.ranges, "disturbances": options.disturbances}
        for w in walkers:
            Conditions.of(w.params, **conditions)
    evaluations = [
        evaluate(
            w.policy,
            w.params,
            task=w.task,
            command=w.command,
            control_period=w.period,
            progress=True,
            **conditions,
        )
        for w in walkers
    ]
    names = [w.name for w in walkers]
    wanted = [
        w.period == CONTROL_PERIOD  # as often as the optimum may change its voltage
        and (has_gaits(w.params) if options.gap is None else options.gap)
        for w in walkers
    ]
    figures = [
        {
            **e.to_dict(),
            "gap": gap_to_optimum(w.params, e.cot, e.speed, progress=True) if asked else None,
            "command": w.command,
            "control_period": w.period,
        }
        for e, w, asked in zip(evaluations, walkers, wanted, strict=True)
    ]
    summary = over_seeds(figures) if options.seeds else {}
    if options.json:
        of = Conditions.of(walkers[0].params, **conditions).to_dict()
        for own in ("params", "speeds", "control_period"):  # each policy has its own
            del of[own]
        results = dict(zip(names, figures, strict=True))
        report = {"policies": results, "over_seeds": summary, **of, **provenance()}
        print(json.dumps(report, indent=1))
    else:
        print_table(names, figures, summary)
    return 0


def walkers_of(name: str, params: WheelParams | None, options: argparse.Namespace) -> list[Walker]:
    """The feedback law of this name about the gait in the options, or the policy in a file.

    A policy that is commanded a speed walks at each of several.

    Raises:
        ValueError: there is no gait, or the gait or the policy is for another machine.
        FileNotFoundError: there is no such file.
    """

    def gait_for(machine: WheelParams) -> Solution:
        if options.gait is not None:
            return Solution.load(options.gait)
        return periodic_gait(machine, options.speed, options.steps, progress=True)

    found = walker(name, gait_for, params, trust_pickle=options.trust_pickle)
    speeds = found.conditions.control.speeds
    if speeds is None:
        return [found]
    commands = options.commands or commands_within(*speeds)
    return [
        dataclasses.replace(found, name=f"{name} at {speed} m/s", command=speed)
        for speed in dict.fromkeys(commands)
    ]


def has_gaits(params: WheelParams) -> bool:
    """Whether gaits of the machine are shipped, so that others are found within seconds."""
    return any(gait.params == params for gait in shipped())


def over_seeds(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Interquartile mean and 95 % interval of each figure over the policies that have it."""
    summary: dict[str, Any] = {}
    for name, _ in COLUMNS[:-1]:
        values = [row[name] for row in rows if row[name] is not None]
        if values:
            low, high = bootstrap_interval(values)
            mean = interquartile_mean(values)
            summary[name] = {"mean": mean, "low": low, "high": high, "seeds": len(values)}
    return summary


def print_table(names: list[str], rows: list[dict[str, Any]], summary: dict[str, Any]) -> None:
    """One line a policy, then the summary, then why starts do not count."""
    width = max(24, *(len(name) for name in names))
    print(" " * width + "".join(f"{title:>16}" for _, title in COLUMNS))
    for name, row in zip(names, rows, strict=True):
        print(f"{name:{width}}" + "".join(_cell(column, row[column]) for column, _ in COLUMNS))
    if summary:
        for title, key in (("interquartile mean", "mean"), ("95 % from", "low"), ("to", "high")):
            cells = [_cell(column, summary.get(column, {}).get(key)) for column, _ in COLUMNS]
            print(f"{title:{width}}" + "".join(cells))
    for name, row in zip(names, rows, strict=True):
        if row["faults"]:
            faults, starts = row["faults"], row["protocol"]["starts"]
            told = ", ".join(f"{count} {verdict}" for verdict, count in faults.items())
            print(f"{name}: {sum(faults.values())} of {starts} starts do not count ({told})")


def _cell(column: str, figure: float | None) -> str:
    """A figure of the table; a dash where nothing walks, or there is nothing to compare with."""
    if figure is None or not math.isfinite(figure):
        return f"{'-':>16}"
    return f"{figure:>+16.1%}" if column == "gap" else f"{figure:16.4g}"
