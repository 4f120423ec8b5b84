"""The headline: learned against optimal cost of transport, on one model, at equal speed.

A study runs in stages, each of which leaves its result in the study's folder. However it was
stopped, the same study goes on: finished stages are kept, and so are the gaits and training states
of the unfinished one. The table is the same as without a stop.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

from agents.comparison.arena import Arena
from agents.comparison.entrants import entrants
from agents.comparison.figures import plot_limit_cycles
from agents.comparison.learned import Learned, learning_curve
from agents.comparison.learning_curves import plot_learning_curves
from agents.comparison.report import by_speed, format_table
from agents.comparison.running import completed
from agents.comparison.speed_figure import plot_cot_against_speed
from agents.comparison.study import Study
from agents.conditions import Conditions
from agents.film import film
from agents.folder import sole_user
from agents.policies import learned_policy
from agents.policy_files import load_policy
from agents.rollout import Rollout, at_rest
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.rendering.wheel import save_gif
from trajopt.files import jsonable, write_text
from trajopt.provenance import provenance

#: Pictures of the animation per second.
FPS = 25

#: Seconds of a walk that are drawn, and those of them that are animated.
DRAWN, ANIMATED = 20.0, 7.0


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
        with sole_user(out):
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
        with sole_user(self.out):
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
        self._draw(rows, [each for each in learned if each.drawn])
        curves = {each.curve: learning_curve(each, results) for each in learned if each.curve}
        plot_learning_curves(self.out / "learning_curves.png", curves, self._arena.held_front)
        return report

    def _draw(self, rows: list[dict[str, Any]], drawn: list[Learned]) -> None:
        """Plots, and an animation of the first of the learners that are drawn."""
        params, walks = self.study.params, {}
        for each in drawn:
            walk = self._walk(each, DRAWN)
            walks[str(each.drawn)] = np.concatenate([i.states for i in walk])
        plot_limit_cycles(
            self.out / "limit_cycles.png", self._arena.held_gait(self.study.speed), walks
        )
        path = self.out / "cot_against_speed.png"
        plot_cot_against_speed(path, self._arena.front, self._arena.held_front, rows)
        if drawn:
            frames = list(film(params, self._walk(drawn[0], ANIMATED), fps=FPS))
            save_gif(frames, self.out / f"{drawn[0].name}.gif", FPS)

    def _walk(self, each: Learned, seconds: float) -> Rollout:
        """A walk of a learner's main policy from rest."""
        params = self.study.params
        policy = learned_policy(load_policy(each.main_file(self.out)).act)
        n_intervals = round(seconds / CONTROL_PERIOD)
        return Rollout(Conditions(params), policy, at_rest(params)[None], n_intervals)


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
