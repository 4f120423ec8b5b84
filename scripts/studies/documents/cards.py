"""The card of a policy that comes with the package: what it is, how it walks, how to make it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from typing import Any

from rimless_gym import Task
from rimless_gym.envs import speed
from scripts.studies.documents.markdown import table

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
30 s. {again} `rimless evaluate {name}` measures this file.
"""

#: The card of a policy that walks at commanded speeds.
COMMANDED = """\
# `{name}`: {title}

{origin}

| | |
| --- | --- |
| task | `RimlessWheelSpeed-v0`, reward {task} |
| commands | {slowest:g} to {fastest:g} m/s, a decision every {period:g} ms |
| machine | `{machine}`{drawn} |
| algorithm | {algo} |
| steps | {steps} |
| seed | {seed} (one seed; figures over seeds are in docs/learning.md) |
| made by | revision {revision} with {versions} |
| licence | MIT, as the rest of the package |

{figures}

Each line is measured by the protocol of the README's table: 128 starts, 50 s each, measured over
the last 30 s, under one command; docs/learning.md also has walks in which it changes. Gaps are to
the optimum at the walked speed. {again}
`rimless evaluate {name} --gap` measures this file.
"""

#: How the policies of the comparison are made again.
COMPARED = "`make compare` trains and measures it again;"

ORIGINS = {
    "scratch": "Learned from nothing: no gait, no demonstration.",
    "imitation": "A clone of the LQR about the environment's own optimum.",
    "imitation of evolution": "A network cloned from the evolved policy: no gait was given.",
}

#: The same where speeds are commanded.
COMMANDED_ORIGINS = ORIGINS | {
    "imitation": "A clone of LQRs about the environment's own optima at several speeds.",
}

#: Of a card's figures: how they are written, and their titles where each command has a line.
FIGURES = {
    "walking_share": ("{:.0%}", "starts that walk"),
    "cot": ("{:.4f}", "CoT"),
    "return": ("{:.3f} m/s", "return"),
    "speed": ("{:.3f} m/s", "speed"),
    "gap": ("{:+.1%}", "gap to the optimum"),
    "friction_demand": ("{:.2f}", "friction demand"),
    "min_normal_force_over_weight": ("{:.2f}", "least Fy / weight"),
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
    shown = {name: _shown(name, row) for name in FIGURES}
    shown["return_"] = shown.pop("return")
    task, origin = _task(record["task"], Task()), _origin(init, ORIGINS)
    return CARD.format(
        name=name,
        title=row["policy"],
        origin=origin,
        task=task,
        machine=machine,
        again=again,
        **_made(record),
        **shown,
    )


def commanded_card(
    name: str,
    record: Mapping[str, Any],
    rows: Sequence[Mapping[str, Any]],
    machine: str,
    init: str,
    again: str,
) -> str:
    """The text of the card of a policy that walks at commanded speeds.

    Args:
        name: of the policy in the package.
        record: of its file.
        rows: of the comparison's table, one for each command, which is its `at`.
        machine: name of its preset.
        init: what its training began from, in words.
        again: how it is made again, a sentence's first half.
    """
    columns = [column for column in FIGURES if column != "return"]
    titles = ["commanded", *(FIGURES[column][1] for column in columns)]
    cells = [[f"{row['at']:g} m/s", *(_shown(column, row) for column in columns)] for row in rows]
    slowest, fastest = record["speeds"]
    return COMMANDED.format(
        name=name,
        title=rows[0]["policy"],
        origin=_origin(init, COMMANDED_ORIGINS),
        task=_task(record["task"], speed.TASK),
        slowest=slowest,
        fastest=fastest,
        period=1e3 * record["control_period"],
        machine=machine,
        figures=table(titles, cells),
        again=again,
        **_made(record),
    )


def _made(record: Mapping[str, Any]) -> dict[str, Any]:
    """What a policy's file tells of its training, in words."""
    drawn = {of: record[of] for of in ("ranges", "disturbances") if record.get(of) is not None}
    return {
        "drawn": "".join(f", {of} {json.dumps(values)}" for of, values in drawn.items()),
        "algo": record["algo"],
        "steps": f"{record['timesteps']:,}" if record["timesteps"] else "none: only cloned",
        "seed": record["seed"],
        "revision": str(record["git_revision"])[:10],
        "versions": ", ".join(f"{key} {value}" for key, value in record["versions"].items()),
    }


def _shown(name: str, row: Mapping[str, Any]) -> str:
    """A figure; a dash where the policy does not have it."""
    form, _ = FIGURES[name]
    return "-" if row[name] is None else form.format(row[name])


def _origin(init: str, origins: Mapping[str, str]) -> str:
    for known, text in sorted(origins.items(), key=lambda item: -len(item[0])):
        if init.startswith(known):
            return text
    return f"It began as: {init}."


def _task(fields: Mapping[str, Any], usual: Task) -> str:
    """What differs from the usual task."""
    registered = dataclasses.asdict(usual)
    changed = {name: value for name, value in fields.items() if value != registered[name]}
    return f"of {json.dumps(changed)}" if changed else "of the task as it is registered"
