"""Search the builds that the preset BUILDABLE was chosen from, and see which of them start.

It takes about half an hour of two cores. After an interruption the same command goes on where it
ended.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from matplotlib.figure import Figure

from agents.cli.options import Count, MaybePath
from rimless_gym.presets import BUILDABLE
from scripts.studies.codesign.gaits import (
    best_gait,
    better_gait,
    figures,
    gait_at,
    held_gait,
    neighbours,
    start_up,
    start_up_and_walk,
)
from scripts.studies.codesign.machine import GPX_22_UP, TOTAL_MASS, Build, chosen, preset_build
from scripts.studies.documents.markdown import formatted, marks, refresh, table
from scripts.studies.stages import gaits_of, stage
from trajopt.store import Store, jsonable, provenance, write_text

LEGS = (5, 6, 7, 8, 9, 10)

#: Builds that cost at most so much more than the best one are tried on starts.
CLOSE = 1.5

#: Starts that are tried of finalists.
FINAL_STARTS = 24

#: Speeds of the preset's table (m/s), and a finalist's second speed in units of its best.
SPEEDS, SLOWER = (0.5, 0.54, 0.58, 0.6, 0.62, 0.6375), 0.9

#: Finalists in the table, those of least cost.
SHOWN = 10

#: The highest cost of transport that is drawn: no build with 62 : 1 costs less.
HIGHEST = 0.15

MARKS = marks("codesign", ("budget", "finals", "preset"))

#: (name, tasks, work) -> results, see `stages.stage`.
Stage: TypeAlias = Callable[..., dict[str, Any]]

#: Tables' columns: heading and format.
PRESET_COLUMNS = {
    "speed": "{speed:.3f}",
    "CoT": "{cot:.4f}",
    "open-loop multiplier": "{multiplier:.1f}",
    "friction demand": "{friction_demand:.2f}",
    "least Fy / weight": "{normal_force:.2f}",
    "peak torque (N m)": "{peak_torque:.2f}",
    "motor speed (rad/s)": "{motor_speed:.0f}",
    "in the gait within 10 s": "{joined:.0%}",
    "walking at the end": "{walking:.0%}",
    "their CoT": "{cot_of_walks:.4f}",
}
FINAL_COLUMNS = {
    "legs": "{legs}",
    "gear": "{ratio:.0f}",
    "bob (kg)": "{bob:.2f}",
    "arm (m)": "{arm:.3f}",
    "speed": "{speed:.3f}",
    "CoT": "{cot:.4f}",
    "in the gait within 10 s": "{joined:.0%}",
}


def codesign(
    *, out: Path = Path("runs/codesign"), workers: Count | None = None, docs: MaybePath = None
) -> int:
    """Search the builds that the preset BUILDABLE was chosen from, and see which of them start.

    Args:
        out: folder of the study.
        workers: processes; by default one for every core.
        docs: a page, docs/machine.md, to put the tables and the figure into.
    """
    with Store(out, provenance()) as store:
        run = partial(stage, store, workers=workers)
        landscape = landscape_of(run)
        results = {
            "landscape": {key: figures(gait) for key, gait in gaits_of(landscape).items()},
            "finals": finals(run, landscape),
            "preset": of_preset(run, landscape),
        }
    write_text(out / "results.json", json.dumps(jsonable(results), indent=1) + "\n")
    draw(results["landscape"], docs.parent if docs else out)
    if docs:
        refresh(docs, MARKS, tables(results))
    print("\n".join(tables(results).values()))
    return 0


def landscape_of(stage: Stage) -> dict[str, Any]:
    """The best gait of every build, from random starts and then from neighbours' gaits."""
    builds = [Build(gear, legs) for legs in LEGS for gear in GPX_22_UP]
    first = stage("landscape", {_key(build): (build,) for build in builds}, best_gait)
    again = {}
    for build in builds:
        near = gaits_of({_key(each): first[_key(each)] for each in neighbours(build, builds)})
        again[_key(build)] = (build, first[_key(build)], tuple(near.values()))
    return stage("landscape from neighbours", again, better_gait)


def finals(stage: Stage, landscape: dict[str, Any]) -> dict[str, Any]:
    """Start-up of the best builds, at their best speed and at a slower one."""
    least = min(gait.cot for gait in gaits_of(landscape).values())
    close = {k: gait for k, gait in gaits_of(landscape).items() if gait.cot <= CLOSE * least}
    tasks = {
        f"{key}_slower": (gait.params, SLOWER * gait.speed, (gait,)) for key, gait in close.items()
    }
    every = close | gaits_of(stage("finalists at a lower speed", tasks, gait_at))
    starts = {key: (gait, FINAL_STARTS) for key, gait in every.items()}
    return stage("start-up of finalists", starts, start_up)


def of_preset(stage: Stage, landscape: dict[str, Any]) -> dict[str, Any]:
    """The preset's gaits over speed, and their start-up with the voltage held."""
    known = tuple(gaits_of({"": landscape[_key(preset_build())]}).values())
    tasks = {f"{speed:.4f}": (BUILDABLE, speed, known) for speed in SPEEDS}
    free = {k: (gait,) for k, gait in gaits_of(stage("preset", tasks, gait_at)).items()}
    held = {k: (g,) for k, g in gaits_of(stage("preset, held", free, held_gait)).items()}
    return stage("start-up of the preset", held, start_up_and_walk)


def _key(build: Build) -> str:
    return f"{build.n_legs:02d}_legs_{build.gearhead.ratio:.0f}"


# -- tables and figures ---------------------------------------------------------------------------


def tables(results: Mapping[str, Any]) -> dict[str, str]:
    """All tables of the page, by name."""
    finals = sorted(results["finals"].values(), key=lambda each: float(each["cot"]))[:SHOWN]
    made = {
        "budget": table(["part", "mass (g)"], _budget()),
        "finals": formatted(FINAL_COLUMNS, finals),
        "preset": formatted(PRESET_COLUMNS, results["preset"].values()),
    }
    return {name: text + "\n" for name, text in made.items()}


def _budget() -> list[list[str]]:
    bob, arm = chosen(BUILDABLE)
    parts = {name: mass for name, (mass, _) in preset_build().wheel_parts().items()}
    parts["bob: steel bar"] = bob
    parts[f"arm of {1000 * arm:.0f} mm and its clamp"] = BUILDABLE.pendulum_mass - bob
    parts["left for payload, at the hub"] = TOTAL_MASS - sum(parts.values())
    rows = [[name, f"{1000 * mass:.0f}"] for name, mass in parts.items()]
    return [*rows, ["**sum**", f"**{1000 * sum(parts.values()):.0f}**"]]


def draw(landscape: Mapping[str, Any], folder: Path) -> None:
    """Write the figure of cost over gear and legs."""
    figure = Figure(figsize=(10, 4.2), layout="constrained")
    panels = figure.subplots(1, 2)
    rows = [row for row in landscape.values() if row["cot"] < HIGHEST]
    for legs in sorted({row["legs"] for row in rows}):
        line = sorted((r for r in rows if r["legs"] == legs), key=lambda r: float(r["ratio"]))
        for panel, name in zip(panels, ("cot", "multiplier"), strict=True):
            ratios = [row["ratio"] for row in line]
            panel.plot(ratios, [row[name] for row in line], "o-", ms=4, label=f"{legs} legs")
    panels[0].set_ylabel("least cost of transport, all power")
    panels[1].set(ylabel="largest open-loop multiplier", yscale="log")
    for panel in panels:
        panel.set(xlabel="gear ratio", xscale="log")
        panel.set_xticks([16, 21, 28, 35], labels=["16", "21", "28", "35"])
        panel.xaxis.minorticks_off()
        panel.grid(alpha=0.3)
    panels[0].legend()
    figure.suptitle("The best gait of every build: bob, arm and speed chosen with it")
    figure.savefig(folder / "machine_landscape.png", dpi=90)
