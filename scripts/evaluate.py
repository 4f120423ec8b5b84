#!/usr/bin/env python
"""Measure walking policies: 128 fixed starts, 50 s, the last 30 s of those that still walk.

With --seeds the policies are those of several seeds of one training: below them stand the
interquartile mean and its 95 % bootstrap interval.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from agents.conditions import Conditions
from agents.evaluate import Evaluation, evaluate
from agents.policies import learned_policy
from agents.policy_files import PRETRAINED, load_policy
from agents.statistics import bootstrap_interval, interquartile_mean
from rimless_gym.envs.disturbances import as_disturbances, as_ranges
from rimless_gym.params import PRESETS, preset
from scripts.commandline import DISTURBANCES, RANGES, Parser, json_object
from trajopt.provenance import provenance

COLUMNS = (
    ("walking_share", "walking"),
    ("speed", "speed m/s"),
    ("cot", "CoT"),
    ("cot_with_regeneration", "CoT regen."),
    ("friction_demand", "friction"),
    ("min_normal_force", "least Fy N"),
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
        help=f"a policy's file (.zip), or one that comes with the package: {', '.join(PRETRAINED)}",
    )
    parser.add_argument(
        "--trust-pickle",
        action="store_true",
        help="also read files of plain stable-baselines3, which runs any code their author put in",
    )
    parser.add_argument(
        "--seeds", action="store_true", help="the policies are seeds of one training: summarise"
    )
    parser.add_argument("--json", action="store_true", help="everything, as JSON")
    parser.add_argument(
        "--preset",
        choices=sorted(PRESETS),
        help="machine that the policies must be for; None: the one each was trained on",
    )
    parser.add_argument("--ranges", type=json_object(as_ranges), help=RANGES)
    parser.add_argument("--disturbances", type=json_object(as_disturbances), help=DISTURBANCES)
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    params = preset(options.preset) if options.preset else None
    with parser.refusing():  # all of them, before the first is measured
        policies = [
            load_policy(path, params, trust_pickle=options.trust_pickle)
            for path in options.policies
        ]
        conditions = {"ranges": options.ranges, "disturbances": options.disturbances}
        for p in policies:
            Conditions.of(p.params, **conditions)
    evaluations = [
        evaluate(learned_policy(p.act), p.params, task=p.task, progress=True, **conditions)
        for p in policies
    ]
    summary = over_seeds(evaluations) if options.seeds else {}
    if options.json:
        results = dict(zip(options.policies, (e.to_dict() for e in evaluations), strict=True))
        of = Conditions.of(policies[0].params, **conditions).to_dict()
        del of["params"]  # each policy has its own machine
        report = {"policies": results, "over_seeds": summary, **of, **provenance()}
        print(json.dumps(report, indent=1))
    else:
        print_table(options.policies, evaluations, summary)
    return 0


def over_seeds(evaluations: list[Evaluation]) -> dict[str, Any]:
    """Interquartile mean and 95 % interval of each figure over the policies that walk."""
    summary: dict[str, Any] = {}
    for name, _ in COLUMNS[:-1]:
        values = [getattr(e, name) for e in evaluations]
        values = [value for value in values if math.isfinite(value)]
        if values:
            low, high = bootstrap_interval(values)
            mean = interquartile_mean(values)
            summary[name] = {"mean": mean, "low": low, "high": high, "seeds": len(values)}
    return summary


def print_table(names: list[str], evaluations: list[Evaluation], summary: dict[str, Any]) -> None:
    """One line a policy, then the summary."""
    width = max(24, *(len(name) for name in names))
    print(" " * width + "".join(f"{title:>14}" for _, title in COLUMNS))
    for name, evaluation in zip(names, evaluations, strict=True):
        figures = [getattr(evaluation, column) for column, _ in COLUMNS]
        print(f"{name:{width}}" + "".join(_cell(figure) for figure in figures))
    if summary:
        for title, key in (("interquartile mean", "mean"), ("95 % from", "low"), ("to", "high")):
            figures = [summary.get(column, {}).get(key, math.nan) for column, _ in COLUMNS]
            print(f"{title:{width}}" + "".join(_cell(figure) for figure in figures))


def _cell(figure: float) -> str:
    """A figure of the table; a dash where nothing walks."""
    return f"{figure:14.4g}" if math.isfinite(figure) else f"{'-':>14}"


if __name__ == "__main__":
    sys.exit(main())
