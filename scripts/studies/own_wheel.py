"""Measure the search for gaits of a user's own machine: how near it comes to a much longer search.

Machines are drawn with every parameter within 50 % of `BUILDABLE`'s or `THESIS_PHYSICAL`'s. The
gait of `periodic_gait` is compared with the best that a full search finds on its mesh: from more
random starts, of another seed, and more shipped gaits. It takes some half an hour of one core;
after Ctrl-C or a kill, the same command continues.
"""

from __future__ import annotations

import dataclasses
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.cli.options import Count, Whole
from rimless_gym import BUILDABLE, THESIS_PHYSICAL, WheelParams
from scripts.studies.documents import markdown
from scripts.studies.stages import stage
from trajopt import NoGaitError, periodic_gait
from trajopt.gaits.search import search_gaits
from trajopt.store import Store, key

#: Machines around which others are drawn, and by what share their parameters differ at most.
BASES, SHARE = {"BUILDABLE": BUILDABLE, "THESIS_PHYSICAL": THESIS_PHYSICAL}, 0.5

#: Parameters that are not drawn: they are no choice of the machine's builder.
FIXED = ("gravity", "friction_width", "slope")

#: Speed (m/s) around which speeds are drawn, as parameters are.
SPEED = 0.4

#: The full search.
FULL: dict[str, Any] = {"starts": 120, "seed": 1, "shipped": 6}

#: The cost that counts as met (relative).
NEAR = 0.03

#: Columns of the table: heading and format.
COLUMNS = {
    "machine": "{machine}",
    "legs": "{legs}",
    "m/s": "{speed:.3f}",
    "CoT": "{cot:.4f}",
    "met by": "{met}",
    "best known": "{best:.4f}",
    "above it": "{above:.1%}",
    "CPU, s": "{seconds:.0f}",
}


class Drawn(NamedTuple):
    """A machine drawn at random: around which one, by which seed, and its number."""

    base: str
    seed: int
    number: int


def own_wheel(
    *,
    machines: Count = 12,
    seed: Whole = 0,
    workers: Count | None = None,
    out: Path = Path("runs/own_wheel"),
) -> int:
    """Measure the search for gaits of machines drawn at random, and print the table.

    Args:
        machines: in all, half of each base.
        seed: by which they are drawn.
        workers: machines at a time; by default one for every core.
        out: folder of the results.
    """
    half = range(machines // len(BASES))
    tasks = {
        key(f"{task.base}_{task.number}", drawn=drawn(task), full=FULL): (task,)
        for task in [Drawn(base, seed, number) for base in BASES for number in half]
    }
    with Store(out) as store:
        rows = stage(store, "usual", tasks, usual, workers)
        best = stage(store, "full", tasks, full, workers)
    for name, row in rows.items():
        row["best"] = min((cot for cot in (row["cot"], best[name]) if cot), default=None)
        row["above"] = row["cot"] / row["best"] - 1 if row["cot"] else None
    print(markdown.formatted(COLUMNS, list(rows.values())))
    walking = [row for row in rows.values() if row["best"]]
    near = sum(row["cot"] is not None and row["above"] <= NEAR for row in walking)
    print(f"within {NEAR:.0%} of the full search: {near} of {len(walking)} machines that walk")
    return 0


def drawn(task: Drawn) -> tuple[WheelParams, float]:
    """A machine at random, and a speed (m/s)."""
    base = BASES[task.base]
    rng = np.random.default_rng([list(BASES).index(task.base), task.number, task.seed])
    values: dict[str, Any] = {}
    for name, value in dataclasses.asdict(base).items():
        if isinstance(value, int | float) and name not in FIXED:
            values[name] = value * rng.uniform(1 - SHARE, 1 + SHARE)
    values["n_legs"] = max(3, round(values["n_legs"]))
    if "pendulum_reach" in values:
        values["pendulum_reach"] = max(values["pendulum_reach"], values["pendulum_length"])
    return base.replace(**values), float(SPEED * rng.uniform(1 - SHARE, 1 + SHARE))


def usual(task: Drawn) -> dict[str, Any]:
    """The gait of `periodic_gait`; without a cost where it found none."""
    params, speed = drawn(task)
    begun, gait = time.process_time(), None
    with suppress(NoGaitError):
        gait = periodic_gait(params, speed)
    return {
        "machine": f"{task.base} {task.number}",
        "legs": params.n_legs,
        "speed": speed,
        "cot": gait.cot if gait and gait.verification.passed else None,
        "met": gait.provenance["met"] if gait else None,
        "seconds": time.process_time() - begun,
    }


def full(task: Drawn) -> float | None:
    """The least cost of transport that the full search finds, if it finds any."""
    params, speed = drawn(task)
    search = search_gaits(params, speed, 1, **FULL)
    return search.optima[0].cost / search.unit[1] if search.optima else None
