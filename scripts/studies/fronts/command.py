"""Search a machine's front of least cost of transport, and ship it.

Two independent seeds screen families of gaits with random starts and continue the good ones from
speed to speed, until both agree; a last sweep looks for anything better. The gaits are solved on
fine meshes, verified, and shipped with the package. A record of the search is written beside them,
and a table and a figure into docs/front.md. After Ctrl-C or a kill the same command goes on where
it ended, and with more minutes it searches further.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from agents.cli.main import run as run_command
from agents.cli.options import Count, Fields, Positive, Preset, machine
from rimless_gym.presets import as_params
from scripts.studies.documents.drawings import save
from scripts.studies.documents.markdown import marks, refresh, table
from scripts.studies.fronts.results import AGREEMENT, SearchResults, disagreements
from scripts.studies.fronts.search import LAST, SEEDS, FineMeshes, FrontSearch, Sweep
from scripts.studies.fronts.solving import Polished
from trajopt import pool
from trajopt.gaits.fronts import CotFront
from trajopt.gaits.library import ARCHIVE, INDEX, shipped
from trajopt.gaits.periodic import NoGaitError
from trajopt.gaits.problem import fastest_walk
from trajopt.gaits.solution import Solution
from trajopt.ocp.ranking import clearly_less
from trajopt.provenance import provenance
from trajopt.store import Store, jsonable, write_bytes, write_text

ROOT = Path(__file__).resolve().parents[3]

#: Origin of a gait that was shipped before and is still the best.
SHIPPED = "shipped before this search"

INK, COLOURS = "#1f2933", {1: "#0f766e", 2: "#c2410c", 3: "#6d28d9"}

#: Gaits of one family are joined by a line if their speeds differ by less (m/s).
LINE = 0.11


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    return run_command(front, arguments, "python -m scripts.studies front")


def front(
    *,
    preset: Preset = "BUILDABLE",
    params: Fields = None,
    minutes: Positive = 120.0,
    workers: Count | None = None,
    grid: Positive = 0.05,
    out: Path = Path("runs/front"),
) -> int:
    """Search a machine's front of least cost of transport, and ship it.

    Args:
        preset: machine.
        params: changes of its fields; its gaits then stay in --out, for a trial.
        minutes: budget of time, on all workers.
        workers: processes; by default one for every core.
        grid: of speeds (m/s).
        out: folder of the search.
    """
    wheel, name = machine(preset, params), preset + ("_CHANGED" if params else "")
    folder = out / name
    if grid > fastest_walk(wheel):
        raise ValueError(
            f"--grid = {grid:g}: must be at most {fastest_walk(wheel):.3g} m/s, the fastest walk "
            "of this machine"
        )
    library = folder / "library" if params else ARCHIVE.parent
    docs = folder if params else ROOT / "docs"
    workers = workers or pool.cores()
    budget = 60.0 * minutes * workers
    run = partial(_run, workers)
    with Store(folder, {"params": wheel.to_dict(), "grid": grid}) as store:
        results = SearchResults(wheel, store)
        sweeps = FrontSearch(results, grid, budget, run)()
        done = FineMeshes(results, budget, run)()
        gaits = chosen(done, [gait for gait in shipped(wheel) if not gait.regeneration])
        content = record(
            name, results, gaits, done, sweeps, {"budget": minutes, "workers": workers}
        )
        ship(library, name, gaits, content)
    print(f"{len(gaits)} gaits are in {library}")
    text = docs / "front.md"
    if not text.exists():
        write_text(text, f"# The front of {name}\n")
    write_section(text, content)
    save(drawn(content), docs / figure_file(name))
    return 0


def _run(workers: int, function: Any, tasks: Iterable[Any], title: str) -> Any:
    return pool.run(function, tasks, workers, progress=title)


def chosen(done: Iterable[Polished], before: Iterable[Solution]) -> list[Solution]:
    """The gaits to ship: the best verified one of every speed, number of steps and of turns.

    Args:
        done: the search's gaits on fine meshes.
        before: gaits of the same machine that were shipped before; one stays unless the search
            found one of less cost at its speed, steps and turns.

    Raises:
        NoGaitError: there is none at all.
    """
    passed = [each.solution for each in done if each.solution is not None and not each.failure]
    best: dict[tuple[float, int, int], Solution] = {}
    for gait in (*passed, *before):
        place = round(gait.speed, 4), gait.steps, gait.theta_turns
        if place not in best or gait.cot < best[place].cot:
            best[place] = gait
    if not best:
        raise NoGaitError(
            "no gait passed its verification yet: give the same command more --minutes"
        )
    return [best[place] for place in sorted(best)]


def record(
    name: str,
    results: SearchResults,
    gaits: Sequence[Solution],
    done: Sequence[Polished],
    sweeps: Sequence[Sweep],
    minutes: Mapping[str, float],
) -> dict[str, Any]:
    """The search's result as plain JSON values: the front, who found each gait, what was tried.

    Args:
        name: of the machine.
        results: of the search.
        gaits: that are shipped.
        done: the search's gaits on fine meshes, the failed ones included.
        sweeps: the last sweeps.
        minutes: budget of time (min) and workers.
    """
    by_seed = [results.costs(seed) for seed in SEEDS]
    gaps = disagreements(*by_seed)
    front = CotFront(tuple(gaits))
    rows = [
        _row(gait, [costs.get(round(gait.speed, 4)) for costs in by_seed]) | {"rest": rest}
        for gait, rest in zip(front.envelope, rests(front), strict=True)
    ]
    others = [gait for gait in gaits if not any(gait is best for best in front.envelope)]
    content = {
        "machine": name,
        "params": results.params.to_dict(),
        "front": rows,
        "other_gaits": [_row(gait, []) for gait in others],
        "speeds_without_verified_gait": sorted(
            set(results.costs(LAST)) - {row["speed"] for row in rows}
        ),
        "failed_on_fine_meshes": [
            {"gait": each.gait.key, "why": each.failure} for each in done if each.failure
        ],
        "seeds": [_effort(results, seed) for seed in SEEDS],
        "last_sweep": _effort(results, LAST),
        "last_sweeps": [sweep._asdict() for sweep in sweeps],
        "agreement": {
            "wanted": AGREEMENT,
            "largest_difference": max(gaps.values(), default=math.inf),
            "differences": {f"{speed:g}": gap for speed, gap in gaps.items()},
        },
        "minutes": {
            **minutes,
            "search_of_one_core": results.seconds / 60,
            "fine_meshes_of_one_core": sum(each.seconds for each in done) / 60,
        },
        "provenance": provenance(),
    }
    return dict(jsonable(content))


def _row(gait: Solution, seeds: Sequence[float | None]) -> dict[str, Any]:
    v = gait.verification
    return {
        "speed": round(gait.speed, 4),
        "steps": gait.steps,
        "turns": gait.theta_turns,
        "cot": gait.cot,
        "cot_of_search": gait.provenance.get("cot_of_search"),
        "cot_of_seeds": list(seeds),
        "found_by": gait.provenance.get("found_by", SHIPPED),
        "friction_demand": max(v.max_friction_demand, v.max_impulse_friction_demand),
        "min_normal_force_over_weight": v.min_normal_force_over_weight,
        "clearance": v.clearance,
    }


def _effort(results: SearchResults, seed: int) -> dict[str, Any]:
    places = list(results.of_seed(seed))
    counts = [count for place in places for count in place.starts.values()]
    return {
        "seed": seed,
        "random_starts": sum(tried for tried, _ in counts),
        "became_gaits": sum(good for _, good in counts),
        "continued_or_joined": sum(len(place.known) for place in places),
        "minutes_of_one_core": sum(place.seconds for place in places) / 60,
    }


def rests(front: CotFront) -> list[dict[str, float] | None]:
    """For every gait of the front the best of walking faster and resting in between; or None.

    Resting draws the idle power alone. A wheel that walks at a speed v for a share s/v of the time
    travels at the mean speed s. Per weight and distance that takes
    cot(v) + idle_power / weight (1 / s - 1 / v). Stop and restart are taken to cost nothing, so
    this is a bound: where it is not below the front, None, resting does not save energy.
    """
    best: list[dict[str, float] | None] = []
    for i, slow in enumerate(front.envelope):
        idle, s = slow.params.idle_power / slow.params.weight, slow.speed
        costs = [(g.cot + idle * (1 / s - 1 / g.speed), g.speed) for g in front.envelope[i + 1 :]]
        cot, walking = min(costs, default=(math.inf, s))
        rest = {"speed": s, "walking": walking, "share": s / walking, "cot": cot}
        best.append(rest if clearly_less(cot, slow.cot) else None)
    return best


def ship(folder: Path, name: str, gaits: Sequence[Solution], content: dict[str, Any]) -> None:
    """Write a machine's gaits into the archive, in place of its older ones, and the record."""
    folder.mkdir(parents=True, exist_ok=True)
    prefix, archive = f"{name.lower()}_", folder / ARCHIVE.name
    files = {n: file for n, file in gait_files(archive).items() if not n.startswith(prefix)}
    with TemporaryDirectory() as temporary:
        for gait in gaits:
            path = Path(temporary) / (
                f"{prefix}{gait.steps}_steps_k{gait.theta_turns}_{gait.speed:.4f}.npz"
            )
            gait.save(path)
            files[path.name] = path.read_bytes()
    write_archive(archive, files)
    text = json.dumps(content, indent=1, allow_nan=False)
    write_text(folder / f"{prefix}front.json", text + "\n")


def gait_files(path: Path) -> dict[str, bytes]:
    """The files of all gaits in an archive, by name; none if there is no archive."""
    if not path.exists():
        return {}
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist() if name != INDEX}


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """Write the archive anew.

    Args:
        path: of the archive.
        files: the files of all its gaits, by name.
    """
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
            gaits.append((name, machine, gait.steps, gait.theta_turns, gait.speed, gait.cot))
        text = json.dumps({"machines": machines, "gaits": gaits}, indent=0)
        archive.writestr(zipfile.ZipInfo(INDEX), text)
    write_bytes(path, content.getvalue())


# -- page and figure ------------------------------------------------------------------------------


def write_section(page: Path, content: dict[str, Any]) -> None:
    """Put a machine's section into a page, between its marks or else at the end."""
    name, text = content["machine"], page.read_text()
    around = marks("front", (name,))
    if not around[name].search(text):
        write_text(page, f"{text.rstrip()}\n\n<!-- front: {name} -->\n<!-- end of {name} -->\n")
    refresh(page, around, {name: section(content)})


def figure_file(name: str) -> str:
    """The name of the figure beside the page."""
    return f"front_{name.lower()}.png"


def section(content: dict[str, Any]) -> str:
    """The section: figure, what the search did, and the table."""
    name, rows, minutes = content["machine"], content["front"], content["minutes"]
    efforts = [*content["seeds"], content["last_sweep"]]
    wanted, gaps = content["agreement"]["wanted"], content["agreement"]["differences"]
    apart = [speed for speed, gap in gaps.items() if gap is None or gap > wanted]
    agree = "agree everywhere" if not apart else f"differ by more at {', '.join(apart)} m/s"
    summary = (
        f"{len(rows)} speeds; {', '.join(str(e['random_starts']) for e in efforts)} random starts "
        f"of seeds 0, 1 and the last sweep, of which "
        f"{', '.join(str(e['became_gaits']) for e in efforts)} became gaits; "
        f"{minutes['search_of_one_core']:.0f} minutes of one core to search, "
        f"{minutes['fine_meshes_of_one_core']:.0f} on fine meshes. To {wanted:.1%} the two seeds "
        f"{agree}; the last sweep gained {max(s['gain'] for s in content['last_sweeps']):.2%}."
    )
    if content["speeds_without_verified_gait"]:
        speeds = ", ".join(f"{v:g}" for v in content["speeds_without_verified_gait"])
        summary += f" No gait at {speeds} m/s passed verification, or time was up before."
    weight = as_params(content["params"]).weight
    head = ["speed (m/s)", "CoT", "power (W)", "steps", "turns", "with rests", "seeds differ"]
    body = [
        [
            f"{row['speed']:g}",
            f"{row['cot']:.5f}",
            f"{row['cot'] * row['speed'] * weight:.3g}",
            str(row["steps"]),
            f"{row['turns']:d}",
            f"{row['rest']['cot']:.5f}" if row["rest"] else "",
            _percent(gaps.get(f"{row['speed']:g}", "")),
        ]
        for row in rows
    ]
    image = f"![The front of {name}]({figure_file(name)})"
    return "\n\n".join([f"## {name}", image, summary, table(head, body)]) + "\n"


def _percent(gap: float | str | None) -> str:
    if gap is None:
        return "one found none"
    return gap if isinstance(gap, str) else f"{gap:.2%}"


def drawn(content: dict[str, Any]) -> Figure:
    """Cost of transport over speed: the front, its families, and the bound with rests."""
    figure = Figure(figsize=(10, 5.6), dpi=110, layout="constrained")
    axes, rows = figure.subplots(), content["front"]
    best = {row["speed"]: row["cot"] for row in rows}
    families: dict[tuple[int, int], list[dict[str, Any]]] = {}
    for row in sorted((*rows, *content["other_gaits"]), key=lambda row: row["speed"]):
        families.setdefault((row["steps"], row["turns"]), []).append(row)
    for (steps, turns), family in sorted(families.items()):
        x = np.array([row["speed"] for row in family])
        y = np.array([row["cot"] for row in family])
        for part in np.split(np.arange(len(x)), np.flatnonzero(np.diff(x) > LINE) + 1):
            axes.plot(x[part], y[part], ".-", color=COLOURS[steps], lw=1, ms=4, alpha=0.75)
        there = [row for row in family if row["cot"] <= best[row["speed"]]]
        if there:  # the number of turns stands at the family's best gait on the front
            row = min(there, key=lambda row: row["cot"])
            axes.annotate(
                f"{turns}",
                (row["speed"], row["cot"]),
                xytext=(0, -11),
                textcoords="offset points",
                ha="center",
                fontsize=8,
                color=COLOURS[steps],
            )
    axes.plot(list(best), list(best.values()), color=INK, lw=2.2, alpha=0.35, label="front")
    rests = [row["rest"] for row in rows if row["rest"]]
    axes.plot(
        [rest["speed"] for rest in rests],
        [rest["cot"] for rest in rests],
        ":",
        color=INK,
        lw=1.2,
        label="walking faster, with rests (a bound)",
    )
    for steps, colour in COLOURS.items():
        axes.plot([], [], ".-", color=colour, label=f"{steps} steps per stride")
    axes.set(
        yscale="log",
        xlabel="speed (m/s)",
        ylabel="cost of transport (E+)",
        title=f"The front of {content['machine']}; numbers: turns of the pendulum per stride",
    )
    axes.grid(alpha=0.25, which="both")
    axes.legend(frameon=False, loc="upper left", fontsize=8)
    return figure
