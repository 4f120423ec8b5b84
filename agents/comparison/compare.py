"""The headline: learned against optimal cost of transport, on one model, at equal speed.

A study runs in stages, each of which leaves its result in the study's folder. However it was
stopped, the same study goes on: finished stages are kept, and so are the gaits and training states
of the unfinished one. The table is the same as without a stop.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib

from agents.comparison.arena import Arena
from agents.comparison.entrants import Entrant, entrants
from agents.comparison.html_report import write_report
from agents.comparison.learned import Learned, learning_curve
from agents.comparison.learning_curves import plot_learning_curves
from agents.comparison.report import by_speed, format_table
from agents.comparison.running import completed
from agents.comparison.shown import cycle_charts, return_charts, shown_walks, walk_from_rest
from agents.comparison.speed_figure import plot_cot_against_speed
from agents.comparison.study import Study
from agents.comparison.style import STYLE
from agents.film import times
from agents.policy_files import load_policy
from agents.race import Race, ghost
from agents.recording import record
from agents.reports.paper import printed, save
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.rendering.display import save_gif
from trajopt.files import jsonable, write_text
from trajopt.provenance import provenance
from trajopt.store import Store

#: Pictures of the animation per second.
FPS = 20

#: Seconds of a walk that are animated.
ANIMATED = 10.0


class Comparison:
    """A study in a folder.

    Args:
        study: what to compare.
        out: folder; may hold the same study, finished or not.
        progress: whether to show progress bars.
        workers: processes that stages share; the results do not depend on their number.

    Raises:
        ValueError: the preset is unknown, or the folder is a file or holds another study.
        OSError: the folder cannot be written.
    """

    def __init__(self, study: Study, out: Path, progress: bool = True, workers: int = 1) -> None:
        self.study, self.out, self.progress, self.workers = study, out, progress, workers
        self._arena = Arena(study, out, progress)
        with Store(out):
            self._claim()

    def _claim(self) -> None:
        """Make the folder this study's, or check that it already is."""
        wanted, written = self._arena.identity, self.out / "study.json"
        if written.exists():
            has = _read_json(written).get("study")
            if not isinstance(has, dict):
                raise ValueError(f"{written}: damaged; remove it, or choose another --out")
            differing = {
                k: f"{has.get(k)} (not {wanted[k]})" for k in wanted if has.get(k) != wanted[k]
            }
            if differing:
                raise ValueError(
                    f"{self.out} holds another study: {differing}; choose another --out, or "
                    "remove it"
                )
        _write_json(written, {"study": wanted} | provenance())

    def run(self) -> dict[str, Any]:
        """Run what is not done yet; return the results, which are also written to results.json.

        Raises:
            ValueError: another process is running it, or one of its files is damaged.
        """
        with Store(self.out):
            return self._run()

    def _run(self) -> dict[str, Any]:
        competing = entrants(self.study)
        results = completed(self._arena, competing, self.workers)
        listed = [row for each in competing for row in each.rows(self._arena, results[each.name])]
        rows = by_speed(listed)
        report = {"study": dataclasses.asdict(self.study), "table": rows, "stages": results}
        report |= provenance()
        _write_json(self.out / "results.json", report)
        write_text(self.out / "table.md", format_table(rows) + "\n")
        learned = [each for each in competing if isinstance(each, Learned)]
        curves = {each.curve: learning_curve(each, results) for each in learned if each.curve}
        self._draw(rows, competing, curves)
        return report

    def _draw(
        self,
        rows: list[dict[str, Any]],
        competing: Sequence[Entrant],
        curves: Mapping[str, Sequence[Mapping[str, Any]]],
    ) -> None:
        """Plots, an animation of the first of the learners that are drawn, the HTML report."""
        arena, out = self._arena, self.out
        plot_cot_against_speed(out / "cot_against_speed.png", arena.front, arena.held_front, rows)
        plot_learning_curves(out / "learning_curves.png", curves, arena.held_front)
        shown = shown_walks(arena, competing)
        cycles, returns = cycle_charts(shown), return_charts(arena.params, shown)
        with matplotlib.rc_context(STYLE):
            save(printed(cycles, across=4), out / "deviations.png")
            save(printed(returns, across=4), out / "return_maps.png")
        filmed = [each for each in competing if isinstance(each, Learned) and each.drawn]
        if filmed:
            policy = load_policy(filmed[0].main_file(out)).policy
            walk = walk_from_rest(arena.params, policy, ANIMATED)
            first, gait = (
                record(filmed[0].name, walk, arena.params, CONTROL_PERIOD),
                arena.held_gait(self.study.speed),
            )
            race = Race([first, ghost(gait, first)], gait)
            frames = [race.frame(time) for time in times(race.ends, FPS)]
            save_gif(frames, out / f"{filmed[0].name}.gif", FPS)
        write_report(arena, rows, (cycles, returns), curves)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        values = json.loads(path.read_text())
        if not isinstance(values, dict):
            raise TypeError(f"{type(values).__name__} instead of an object")
        return values
    except (ValueError, TypeError, RecursionError) as error:
        raise ValueError(
            f"{path}: damaged ({error}); remove it to run its stage again, or choose another --out"
        ) from error


def _write_json(path: Path, values: Any) -> None:
    write_text(path, json.dumps(jsonable(values), indent=1) + "\n")
