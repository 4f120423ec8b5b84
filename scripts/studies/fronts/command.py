"""Search a machine's front of least cost of transport, and ship it.

Two independent seeds screen families of gaits with random starts and continue the good ones from
speed to speed, until both agree; a last sweep looks for anything better. The gaits are solved on
fine meshes, verified, and shipped with the package; a table and a figure go into docs/front.md.
After Ctrl-C or a kill the same command goes on where it ended.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from agents.cli.options import Count, Preset
from rimless_gym.presets import as_params
from scripts.studies.documents.markdown import marks, refresh, table
from scripts.studies.fronts.results import AGREEMENT, STEPS, SearchResults, disagreements
from scripts.studies.fronts.search import SEEDS, FineMeshes, FrontSearch
from scripts.studies.stages import stage
from trajopt import pool
from trajopt.gaits.fronts import CotFront, shipped_front
from trajopt.gaits.library import ARCHIVE, INDEX, index, shipped, shipped_gait
from trajopt.gaits.periodic import NoGaitError
from trajopt.gaits.solution import Solution
from trajopt.ocp.arrays import Array
from trajopt.ocp.ranking import clearly_less
from trajopt.store import Store, write_bytes

DOCS = Path(__file__).resolve().parents[3] / "docs"

#: Distance of the speeds that are searched (m/s).
GRID = 0.05

#: Windows of so many steps: what strides of at most so many steps cost at least is listed.
WINDOWS = (3, 5, 10, 20)

#: Strides of so many steps and more are of one kind in the figure.
LONG = STEPS[-1] + 1

INK, COLOURS = "#1f2933", {1: "#0f766e", 2: "#c2410c", 3: "#6d28d9", LONG: "#be185d"}

#: Gaits of one family are joined by a line if their speeds differ by less (m/s).
LINE = 0.11


def front(
    *, preset: Preset = "BUILDABLE", workers: Count | None = None, out: Path = Path("runs/front")
) -> int:
    """Search a machine's front of least cost of transport, and ship it.

    Args:
        preset: machine.
        workers: processes; by default one for every core.
        out: folder of the search.
    """
    params = as_params(preset)
    with Store(out / preset, {"params": params.to_dict()}) as store:
        results = SearchResults(params, store)
        gain = FrontSearch(results, GRID, partial(pool.run, workers=workers))()
        done = FineMeshes(results, partial(stage, store, workers=workers))()
    ship(ARCHIVE, preset, chosen([*done, *(g for g in shipped(params) if not g.regeneration)]))
    refresh(DOCS / "front.md", marks("search", (preset,)), {preset: summary(preset, results, gain)})
    publish(preset)
    return 0


def publish(preset: str) -> None:
    """Write the page's section and figure of a machine from its shipped gaits."""
    index.cache_clear()
    shipped_gait.cache_clear()
    front = shipped_front(as_params(preset))
    print(f"{len(front.solutions)} gaits of {preset} are shipped")
    refresh(DOCS / "front.md", marks("front", (preset,)), {preset: section(preset, front)})
    save_picture(drawn(preset, front), DOCS / figure_file(preset))


def chosen(gaits: Iterable[Solution]) -> list[Solution]:
    """The gaits to ship: of those that are new or shipped, the best of a speed, steps and turns.

    Long strides only where none of as many steps or fewer costs less.
    """
    best: dict[tuple[float, int, int, bool], Solution] = {}
    for gait in gaits:
        place = round(gait.speed, 4), gait.steps, gait.theta_turns, gait.double_stance
        if place not in best or gait.cot < best[place].cot:
            best[place] = gait
    if not best:
        raise NoGaitError("no gait passed its verification")
    return [best[place] for place in sorted(best) if not _dominated(best[place], best.values())]


def _dominated(gait: Solution, gaits: Iterable[Solution]) -> bool:
    """Whether a long stride costs more than another of its speed with as many steps or fewer."""
    rivals = [
        other
        for other in gaits
        if other.steps <= gait.steps and round(other.speed, 4) == round(gait.speed, 4)
    ]
    long = gait.steps >= LONG and not gait.double_stance
    return long and any(other.cot < gait.cot for other in rivals)


def ship(archive: Path, name: str, gaits: Sequence[Solution]) -> None:
    """Write a machine's gaits into an archive, in place of its older ones."""
    prefix = f"{name.lower()}_"
    files = {n: file for n, file in gait_files(archive).items() if not n.startswith(prefix)}
    with TemporaryDirectory() as temporary:
        for gait in gaits:
            stop = "_stop" if gait.double_stance else ""
            path = Path(temporary) / (
                f"{prefix}{gait.steps}_steps_k{gait.theta_turns}_{gait.speed:.4f}{stop}.npz"
            )
            gait.save(path)
            files[path.name] = path.read_bytes()
    write_archive(archive, files)


def gait_files(path: Path) -> dict[str, bytes]:
    """The files of all gaits in an archive, by name; none if there is no archive."""
    if not path.exists():
        return {}
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name != INDEX}


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """Write an archive anew with the files of all its gaits, by name."""
    machines: list[dict[str, object]] = []
    gaits: list[tuple[object, ...]] = []
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name in sorted(files):
            archive.writestr(zipfile.ZipInfo(name), files[name])
            gait = Solution.load(io.BytesIO(files[name]))
            if gait.params.to_dict() not in machines:
                machines.append(gait.params.to_dict())
            machine = machines.index(gait.params.to_dict())
            figures = gait.steps, gait.theta_turns, gait.speed, gait.cot, gait.double_stance
            gaits.append((name, machine, *figures))
        text = json.dumps({"machines": machines, "gaits": gaits}, indent=0)
        archive.writestr(zipfile.ZipInfo(INDEX), text)
    write_bytes(path, content.getvalue())


# -- page and figure ------------------------------------------------------------------------------


def figure_file(name: str) -> str:
    """The name of the figure beside the page."""
    return f"front_{name.lower()}.png"


def summary(name: str, results: SearchResults, gain: float) -> str:
    """What the search of a machine did, in a line; `gain` is that of the last sweep."""
    gaps = disagreements(*(results.costs(seed) for seed in SEEDS))
    apart = [f"{speed:g}" for speed, gap in gaps.items() if gap > AGREEMENT]
    agree = "agree everywhere" if not apart else f"differ by more at {', '.join(apart)} m/s"
    return (
        f"{name}: {len(gaps)} speeds, up to {STEPS[-1]} steps. "
        f"To {AGREEMENT:.1%} the two seeds {agree}; the last sweep gained {gain:.2%}.\n"
    )


def section(name: str, front: CotFront) -> str:
    """The section: the figure, the table without empty columns, and what windows can repeat.

    Windows are compared at the speeds at which the shortest ones have a gait.
    """
    infimum, gaits = hull(front), front.envelope
    columns = {
        "speed (m/s)": [f"{round(g.speed, 4):g}" for g in gaits],
        "CoT": [f"{g.cot:.5f}" for g in gaits],
        "above the bound": [f"{g.cot / g.cot_bound - 1:.1%}" if g.cot_bound else "" for g in gaits],
        "steps": [f"{g.steps}" for g in gaits],
        "turns": [f"{g.theta_turns}" for g in gaits],
        "hull": [
            f"{cot:.5f}" if clearly_less(cot, g.cot) else ""
            for g, cot in zip(gaits, infimum, strict=True)
        ],
    }
    filled = {head: cells for head, cells in columns.items() if any(cells)}
    rows = zip(*filled.values(), strict=True)
    parts = [
        f"## {name}",
        f"![The front of {name}]({figure_file(name)})",
        table(list(filled), rows),
    ]
    every, costs = _costs(front, WINDOWS[-1]), [_costs(front, most) for most in WINDOWS[:-1]]
    windows = [
        [f"{speed:g}", *(f"{of[speed]:.5f}" for of in costs)]
        for speed, cot in every.items()
        if speed in costs[0] and clearly_less(cot, costs[0][speed])
    ]
    if windows:
        head = ["speed (m/s)", *(f"up to {most} steps" for most in WINDOWS[:-1])]
        parts.append(table(head, windows))
    return "\n\n".join(parts) + "\n"


def _costs(front: CotFront, most: int) -> dict[float, float]:
    """The costs of transport of strides of up to so many steps, by speed (m/s)."""
    short = CotFront(tuple(gait for gait in front.solutions if gait.steps <= most))
    return {round(gait.speed, 4): gait.cot for gait in short.envelope}


def hull(front: CotFront) -> Array:
    """The convex hull of mean power over mean speed, as CoT at the speeds of the front, (N,).

    Its vertices are gaits, and rest, where the wheel draws its idle power alone. A wheel that
    changes between the two vertices around a speed has this CoT in the limit of long times, where
    the changes cost nothing; no mixture of gaits and rest costs less.
    """
    weight, idle = front.envelope[0].params.weight, front.envelope[0].params.idle_power
    vertices = [(0.0, idle)]
    for gait in front.envelope:
        speed, power = gait.speed, gait.cot * gait.speed * weight
        while len(vertices) > 1:
            (x, y), (x_last, y_last) = vertices[-2:]
            if (y_last - y) * (speed - x) < (power - y) * (x_last - x):
                break
            vertices.pop()
        vertices.append((speed, power))
    speeds = np.array([gait.speed for gait in front.envelope])
    return np.interp(speeds, *np.array(vertices).T) / (weight * speeds)


def save_picture(figure: Figure, path: Path) -> None:
    """Write a PNG with a palette, which keeps the file small."""
    picture = io.BytesIO()
    figure.savefig(picture, dpi="figure")
    image = Image.open(picture).convert("RGB")
    image.quantize(200, dither=Image.Dither.NONE).save(path, optimize=True)


def drawn(name: str, front: CotFront) -> Figure:
    """Cost of transport over speed: the front and its families."""
    figure = Figure(figsize=(10, 5.6), dpi=110, layout="constrained")
    axes = figure.subplots()
    families: dict[tuple[int, int], list[Solution]] = {}
    for gait in sorted(front.solutions, key=lambda gait: gait.speed):
        kind = (LONG, 0) if gait.steps >= LONG else (gait.steps, gait.theta_turns)
        families.setdefault(kind, []).append(gait)
    for (steps, turns), family in sorted(families.items()):
        x = np.array([gait.speed for gait in family])
        y = np.array([gait.cot for gait in family])
        for part in np.split(np.arange(len(x)), np.flatnonzero(np.diff(x) > LINE) + 1):
            axes.plot(x[part], y[part], ".-", color=COLOURS[steps], lw=1, ms=4, alpha=0.75)
        on_front = [gait for gait in family if any(gait is each for each in front.envelope)]
        if on_front and steps < LONG:  # the turns stand at the family's best gait on the front
            best = min(on_front, key=lambda gait: gait.cot)
            below: dict[str, Any] = {"xytext": (0, -11), "textcoords": "offset points"}
            style: dict[str, Any] = {"ha": "center", "fontsize": 8, "color": COLOURS[steps]}
            axes.annotate(f"{turns}", (best.speed, best.cot), **below, **style)
    speeds, costs = zip(*((gait.speed, gait.cot) for gait in front.envelope), strict=True)
    axes.plot(speeds, costs, color=INK, lw=2.2, alpha=0.35, label="front")
    axes.plot(speeds, hull(front), "--", color=INK, lw=1, alpha=0.6, label="hull: long times")
    for steps, colour in COLOURS.items():
        label = f"{steps} or more" if steps == LONG else f"{steps}"
        axes.plot([], [], ".-", color=colour, label=f"{label} steps per stride")
    axes.set(
        yscale="log",
        xlabel="speed (m/s)",
        ylabel="cost of transport (E+)",
        title=f"The front of {name}; numbers: turns of the pendulum per stride",
    )
    axes.grid(alpha=0.25, which="both")
    axes.legend(frameon=False, loc="upper left", fontsize=8)
    return figure
