"""The card of a policy that comes with the package: what it is, how it walks, how to make it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from typing import Any

from rimless_gym import Task

CARD = """\
# `{name}`: {title}

{origin}

| | |
| --- | --- |
| task | `RimlessWheel-v0`, reward {task} |
| machine | `{machine}`{drawn} |
| algorithm | {algo} |
| steps | {steps} |
| seed | {seed} (one seed; figures over seeds are in docs/learning.md) |
| starts that walk | {walking_share} |
| CoT | {cot} |
| return | {return_} |
| speed | {speed} |
| gap to the optimum at this speed | {gap} |
| friction demand, least Fy / weight | {friction_demand}, {min_normal_force_over_weight} |
| made by | revision {revision} with {versions} |
| licence | MIT, as the rest of the package |

The figures are by the protocol of the README's table: 128 starts, 50 s each, measured over the last
30 s. {again} `python scripts/evaluate.py {name}` measures this file.
"""

#: How the policies of the comparison are made again.
COMPARED = "`make compare` trains and measures it again;"

ORIGINS = {
    "scratch": "Learned from nothing: no gait, no demonstration.",
    "imitation": "A clone of the LQR about the environment's own optimum.",
    "imitation of evolution": "A network cloned from the evolved policy: no gait was given.",
}


def card(
    name: str,
    record: Mapping[str, Any],
    row: Mapping[str, Any],
    machine: str,
    init: str,
    again: str = COMPARED,
) -> str:
    """The text of a card.

    Args:
        name: of the policy in the package.
        record: of its file.
        row: of the comparison's table.
        machine: name of its preset.
        init: what its training began from, in words.
        again: how it is made again, a sentence's first half.
    """
    drawn = {
        name: record[name] for name in ("ranges", "disturbances") if record.get(name) is not None
    }
    shown = {
        "walking_share": ("{:.0%}", row["walking_share"]),
        "cot": ("{:.4f}", row["cot"]),
        "return_": ("{:.3f} m/s", row["return"]),
        "speed": ("{:.3f} m/s", row["speed"]),
        "gap": ("{:+.1%}", row["gap"]),
        "friction_demand": ("{:.2f}", row["friction_demand"]),
        "min_normal_force_over_weight": ("{:.2f}", row["min_normal_force_over_weight"]),
    }
    return CARD.format(
        name=name,
        title=row["policy"],
        origin=_origin(init),
        task=_task(record["task"]),
        machine=machine,
        drawn="".join(f", {of} {json.dumps(values)}" for of, values in drawn.items()),
        algo=record["algo"],
        steps=f"{record['timesteps']:,}" if record["timesteps"] else "none: only cloned",
        seed=record["seed"],
        again=again,
        revision=str(record["git_revision"])[:10],
        versions=", ".join(f"{key} {value}" for key, value in record["versions"].items()),
        **{key: "-" if x is None else form.format(x) for key, (form, x) in shown.items()},
    )


def _origin(init: str) -> str:
    for known, text in sorted(ORIGINS.items(), key=lambda item: -len(item[0])):
        if init.startswith(known):
            return text
    return f"It began as: {init}."


def _task(fields: Mapping[str, Any]) -> str:
    """What differs from the usual task."""
    usual = dataclasses.asdict(Task())
    changed = {name: value for name, value in fields.items() if value != usual[name]}
    return f"of {json.dumps(changed)}" if changed else "of the task as it is registered"
