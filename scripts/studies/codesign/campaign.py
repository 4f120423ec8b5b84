"""Search builds and pendulums, see which of them start, and write the page and its figures."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from rimless_gym.presets import BUILDABLE
from scripts.studies.codesign import budget, gaits, page, parts, problem, slower, startup
from scripts.studies.codesign.budget import Build
from scripts.studies.codesign.gaits import cheaper, cheapest
from scripts.studies.codesign.parts import GPX_22_UP
from scripts.studies.codesign.problem import Case, neighbours
from scripts.studies.codesign.slower import at_speed, at_speeds, held_gait
from scripts.studies.codesign.stages import stage
from scripts.studies.codesign.startup import joined, judged
from trajopt.files import jsonable, write_text
from trajopt.gaits.solution import Solution
from trajopt.provenance import provenance

LEGS = (5, 6, 7, 8, 9, 10)

#: Families by turns of the pendulum per step, and the builds they are tried on.
TURNS, TRIED_ON = (-2, 0, 1), ((6, "35:1"), (7, "21:1"), (8, "28:1"))

#: Pendulums of the map, on the build of the preset: bobs (kg) and arms (m).
BOBS, ARMS = (1.4, 1.45, 1.5, 1.55), (0.137, 0.147, 0.157, 0.167)

#: Random starts of a pendulum on the map, which begins from the best one's gait too, and of a
#: family that is seldom found.
FEW_STARTS, MANY_STARTS = 1, 8

#: Builds that cost at most so much more than the cheapest one are tried on starts.
CLOSE = 1.5

#: Starts that are tried: of finalists, and of every pendulum on the map.
FINAL_STARTS, MAP_STARTS = 24, 16

#: Speeds of the preset's own table (m/s), and a finalist's second speed in units of its best.
SPEEDS, SLOWER = (0.5, 0.54, 0.58, 0.6, 0.62, 0.6375), 0.9


def campaign(folder: Path, workers: int, docs: Path | None) -> None:
    """Run all stages, or go on with them; print the tables.

    Args:
        folder: of the results.
        workers: processes.
        docs: page to put the tables into, with its figures beside it, if any.

    Raises:
        ValueError: the folder holds a study with other numbers.
    """
    same_study(folder / "study.json")
    landscape = _landscape(folder, workers)
    families = _families(folder, workers)
    own = _own(folder, landscape, workers)
    finals = _finals(folder, landscape, workers)
    pendulums = _pendulums(folder, landscape, workers)
    found = {
        "landscape": {key: page.row(gait) for key, gait in landscape.items()},
        "families": {key: page.row(gait) for key, gait in families.items()},
        "finals": finals,
        "pendulums": pendulums,
        "preset": own,
        "provenance": provenance(),
    }
    write_text(folder / "results.json", json.dumps(jsonable(found), indent=1) + "\n")
    page.draw(found, docs.parent if docs else folder)
    if docs:
        page.refresh(docs, found)
    print("\n".join(page.tables(found).values()))


def same_study(path: Path) -> None:
    """Refuse to go on with results that were found with other parts, limits or settings.

    Raises:
        ValueError: they are those of another study.
    """
    modules = (parts, budget, problem, gaits, slower, startup, sys.modules[__name__])
    own = {
        f"{module.__name__.rpartition('.')[2]}.{name}": repr(value)
        for module in modules
        for name, value in vars(module).items()
        if name.isupper() and not name.startswith("_")
    }
    try:
        known = dict(json.loads(path.read_text())) if path.exists() else own
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path}: damaged ({error}); delete the folder {path.parent}") from error
    other = sorted(name for name in {*own, *known} if own.get(name) != known.get(name))
    if other:
        raise ValueError(
            f"{path.parent}: holds results that were found with another {', '.join(other)}; give "
            "another --out, or delete the folder"
        )
    write_text(path, json.dumps(own, indent=1) + "\n")


def _key(case: Case) -> str:
    key = f"{case.build.n_legs:02d}_legs_{case.build.gearhead.ratio:.0f}"
    if case.bob is not None and case.arm is not None:
        key += f"_{case.bob:.3f}_kg_{case.arm:.3f}_m"
    return key if case.turns == -1 else f"{key}_turns_{case.turns}"


def _landscape(folder: Path, workers: int) -> dict[str, Any]:
    cases = {_key(c): c for c in (Case(Build(g, n)) for n in LEGS for g in GPX_22_UP)}
    tasks = {key: (case,) for key, case in cases.items()}
    first = stage(folder, "landscape", tasks, cheapest, workers)
    return _swept(folder, "landscape from neighbours", cases, first, workers)


def _swept(
    folder: Path, name: str, cases: dict[str, Case], first: dict[str, Any], workers: int
) -> dict[str, Any]:
    every = list(cases.values())
    tasks = {
        key: (case, first[key], _gaits(first[_key(c)] for c in neighbours(case, every)))
        for key, case in cases.items()
    }
    return stage(folder, name, tasks, cheaper, workers)


def _families(folder: Path, workers: int) -> dict[str, Any]:
    gears = {f"{gear.ratio:.0f}:1": gear for gear in GPX_22_UP}
    cases = [Case(Build(gears[g], n), turns) for n, g in TRIED_ON for turns in TURNS]
    tasks = {_key(case): (case, (), MANY_STARTS) for case in cases}
    return stage(folder, "families", tasks, cheapest, workers)


def _finals(folder: Path, landscape: dict[str, Any], workers: int) -> dict[str, Any]:
    """Start-up of the cheapest builds, at their best speed and at a slower one."""
    gaits = {key: gait for key, gait in landscape.items() if isinstance(gait, Solution)}
    least = min(gait.cot for gait in gaits.values())
    close = {key: gait for key, gait in gaits.items() if gait.cot <= CLOSE * least}
    slow = {f"{key}_slower": (gait, SLOWER * gait.speed) for key, gait in close.items()}
    slower = stage(folder, "finalists at a lower speed", slow, at_speed, workers)
    every = close | {key: gait for key, gait in slower.items() if isinstance(gait, Solution)}
    tasks = {key: (gait, FINAL_STARTS) for key, gait in every.items()}
    return stage(folder, "start-up of finalists", tasks, joined, workers)


def _pendulums(folder: Path, landscape: dict[str, Any], workers: int) -> dict[str, Any]:
    """Gaits and start-up over bob and arm, on the build of the preset."""
    build = _own_build()
    known = _gaits([landscape[_key(Case(build))]])
    cases = {
        _key(case): case
        for case in (Case(build, bob=b, arm=a, lifts=False) for b in BOBS for a in ARMS)
    }
    tasks = {key: (case, known, FEW_STARTS) for key, case in cases.items()}
    gaits = stage(folder, "pendulums", tasks, cheapest, workers)
    gaits = _swept(folder, "pendulums from neighbours", cases, gaits, workers)
    walking = {key: gait for key, gait in gaits.items() if isinstance(gait, Solution)}
    starts = {key: (gait, MAP_STARTS) for key, gait in walking.items()}
    return stage(folder, "start-up of pendulums", starts, joined, workers)


def _own(folder: Path, landscape: dict[str, Any], workers: int) -> dict[str, Any]:
    """The preset's own gaits over speed, and their start-up with the voltage held."""
    known = _gaits([landscape[_key(Case(_own_build()))]])
    tasks = {f"{speed:.4f}": (BUILDABLE, speed, known) for speed in SPEEDS}
    gaits = stage(folder, "preset", tasks, at_speeds, workers)
    walking = {key: gait for key, gait in gaits.items() if isinstance(gait, Solution)}
    held = stage(
        folder, "preset, held", {k: (gait,) for k, gait in walking.items()}, held_gait, workers
    )
    starts = {key: (gait,) for key, gait in held.items() if isinstance(gait, Solution)}
    return stage(folder, "start-up of the preset", starts, judged, workers)


def _own_build() -> Build:
    """The build of the preset."""
    gear = min(GPX_22_UP, key=lambda g: abs(g.ratio - BUILDABLE.gear_ratio))
    return Build(gear, BUILDABLE.n_legs)


def _gaits(found: Any) -> tuple[Solution, ...]:
    return tuple(each for each in found if isinstance(each, Solution))
