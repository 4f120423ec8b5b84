"""The headline: learned against optimal cost of transport, on one model, at equal speed.

A study runs in stages, each of which leaves its result in the study's folder. However it was
stopped, the same study goes on: finished stages are kept, and so are the gaits and training states
of the unfinished one. The table is the same as without a stop.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import sys
import time
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from agents.checkpoint import load_policy
from agents.evaluate import Evaluation, evaluate
from agents.figures import Walk, animate, plot_cot_against_speed, plot_limit_cycles, record
from agents.folder import BEST, CLONE, LAST, sole_user
from agents.policies import Policy, controller_policy, model_policy
from agents.report import format_table, gait_row, policy_row
from agents.stages import read_stage, write_stage
from agents.study import Study
from agents.train import train
from rimless_gym.hybrid import DOUBLE
from rimless_gym.kernel.stepping import MODE, PHI, STATE_SIZE
from trajopt import NoGaitError, Solution, periodic_gait
from trajopt.feedback import Controller, law
from trajopt.files import jsonable, write_text
from trajopt.gaits.front_files import front_file
from trajopt.gaits.fronts import CotFront, cot_front
from trajopt.gaits.shipped import leads_for
from trajopt.ocp.solving.ties import tied
from trajopt.provenance import provenance

#: Strides considered for the optimal front.
FRONT_STEPS = (1, 2, 3)

#: Where the trainings leave the policies that are shown.
CLONED, TUNED = f"imitation/{CLONE}", f"fine_tuned/{BEST}"


class Comparison:
    """A study in a folder.

    Args:
        study: what to compare.
        out: folder; may hold the same study, finished or not.
        progress: whether to show progress bars.

    Raises:
        ValueError: the preset is unknown, or the folder is a file or holds another study.
        OSError: the folder cannot be written.
    """

    def __init__(self, study: Study, out: Path, progress: bool = True) -> None:
        self.study, self.out, self.progress = study, out, progress
        self.params = study.params
        self._wanted = json.loads(json.dumps(dataclasses.asdict(study)))
        with sole_user(out):
            self._claim()

    def _claim(self) -> None:
        """Make the folder that of this study, or find that it is already."""
        wanted, written = self._wanted, self.out / "study.json"
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
        stages: dict[str, Callable[[], dict[str, Any]]] = {
            "gait": self._solve_gait,
            "swinging": self._solve_swinging_gait,
            "front": self._solve_front,
            "lqr": self._evaluate_lqr,
            "imitation": self._imitate,
            "fine_tuned": self._fine_tune,
            "scratch": self._train_from_scratch,
        }
        done = {}
        for i, (name, work) in enumerate(stages.items(), start=1):
            if self.progress:
                tqdm.write(f"[{i}/{len(stages)}] {name}", sys.stderr)
            done[name] = self._stage(name, work)
        return self._report(done)

    def _stage(self, name: str, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """The result of a stage, from its file if it was run before and its files are unchanged."""
        made_by = provenance()
        result, changed = read_stage(self.out, name, self._wanted)
        if changed:
            self._tell(f"{', '.join(changed)} is missing or changed: run again")
            shutil.rmtree(self.out / name, ignore_errors=True)  # of a training
        if result is None or changed:
            began = time.perf_counter()
            done = work() | {"wall_time_s": round(time.perf_counter() - began, 1)} | made_by
            write_stage(self.out, name, self._wanted, done)
            result = read_stage(self.out, name, self._wanted)[0] or {}
            self._tell(f"done in {result['wall_time_s']} s")
        else:
            self._tell("kept")
        if result["git_revision"] != made_by["git_revision"]:
            self._tell(
                f"warning: {name} was made by revision {result['git_revision']}, this is "
                f"{made_by['git_revision']}; remove {self.out} to make it anew"
            )
        return result

    def _tell(self, text: str) -> None:
        if self.progress:
            tqdm.write(f"      {text}", sys.stderr)

    # -- stages -------------------------------------------------------------------------------

    def _solve_gait(self) -> dict[str, Any]:
        study = self.study
        gait = periodic_gait(
            self.params,
            study.speed,
            study.steps,
            starts=study.starts,
            seed=study.seed,
            workers=os.cpu_count() or 1,
            progress=self.progress,
        )
        gait.save(self.out / "gait.npz")
        return _gait_result(gait) | {"files": ["gait.npz"]}

    def _solve_swinging_gait(self) -> dict[str, Any]:
        """The best gait whose pendulum does not whirl, where one is shipped to start from."""
        study = self.study
        known = leads_for(self.params, study.speed, study.steps)
        swinging = [gait for gait in known if gait.theta_turns == 0 and gait.params == self.params]
        if not swinging:
            return {
                "missing": f"no swinging gait of {study.steps} steps is shipped for this machine"
            }
        gait = periodic_gait(self.params, study.speed, study.steps, guess=swinging[0])
        gait.save(self.out / "swinging.npz")
        return _gait_result(gait) | {"files": ["swinging.npz"]}

    def _solve_front(self) -> dict[str, Any]:
        speeds = sorted({*self.study.front, self.study.speed})
        front = cot_front(self.params, speeds, FRONT_STEPS, folder=self.out, progress=self.progress)
        names = [front_file(s.steps, s.speed) for s in front.solutions]
        gaits = [_gait_result(s) | {"steps": s.steps} for s in front.solutions]
        return {"files": names, "gaits": gaits, "missing": [list(m) for m in front.missing]}

    def _evaluate_lqr(self) -> dict[str, Any]:
        policy = controller_policy(self.params, self.expert)
        return self._evaluated(policy)

    def _imitate(self) -> dict[str, Any]:
        result = self._trained("imitation", "imitation", 0)
        clone = self.out / CLONED
        return self._evaluated(_learned(clone)) | result | {"files": [CLONED]}

    def _fine_tune(self) -> dict[str, Any]:
        result = self._trained("fine_tuned", self.out / CLONED, self.study.timesteps)
        last = self._evaluated(_learned(self.out / "fine_tuned" / LAST))
        best = self._evaluated(_learned(self.out / TUNED))
        return best | result | {"last": last, "files": [TUNED]}

    def _train_from_scratch(self) -> dict[str, Any]:
        result = self._trained("scratch", "scratch", self.study.timesteps)
        return self._evaluated(_learned(self.out / "scratch" / BEST)) | result

    def _trained(self, name: str, init: str | Path, timesteps: int) -> dict[str, Any]:
        result = train(
            "ppo",
            init,
            self.study.seed,
            self.out / name,
            timesteps=timesteps,
            params=self.params,
            expert=self.expert,
            progress=self.progress,
        )
        if result.interrupted:
            raise KeyboardInterrupt
        return {"timesteps": result.timesteps}

    def _evaluated(self, policy: Policy) -> dict[str, Any]:
        evaluation: Evaluation = evaluate(policy, self.params, progress=self.progress)
        return {"evaluation": evaluation.to_dict()}

    # -- what the stages share ------------------------------------------------------------------

    @cached_property
    def front(self) -> CotFront:
        """The optimal front, as the stage left it."""
        names = (read_stage(self.out, "front", self._wanted)[0] or {})["files"]
        return CotFront(tuple(Solution.load(self.out / name) for name in names))

    @cached_property
    def best_gait(self) -> Solution:
        """The best gait at the study's speed, of the fewest steps: the one to imitate."""
        at_speed = [s for s in self.front.solutions if abs(s.speed - self.study.speed) < 1e-6]
        if not at_speed:
            raise NoGaitError(
                f"speed = {self.study.speed} m/s: no verified gait; {self.out}/front.json says "
                "why; choose a speed between those that were found"
            )
        lowest = min(s.cot for s in at_speed)
        as_good = [s for s in at_speed if tied(s.cot, lowest, 1e-4)]
        return min(as_good, key=lambda s: s.steps)

    @cached_property
    def expert(self) -> Controller:
        """The feedback law that holds it."""
        return law("lqr")(self.best_gait)

    def _report(self, done: dict[str, dict[str, Any]]) -> dict[str, Any]:
        rows = [
            *self._optimal_rows(done),
            policy_row("LQR about the optimum", done["lqr"], self.front),
            policy_row("imitation", done["imitation"], self.front),
            policy_row("fine-tuned, best kept", done["fine_tuned"], self.front),
            policy_row(
                "fine-tuned, last", done["fine_tuned"] | done["fine_tuned"]["last"], self.front
            ),
            policy_row("from scratch", done["scratch"], self.front),
        ]
        results = {"study": dataclasses.asdict(self.study), "table": rows, "stages": done}
        results |= provenance()
        _write_json(self.out / "results.json", results)
        write_text(self.out / "table.md", format_table(rows) + "\n")
        self._draw(rows)
        return results

    def _optimal_rows(self, done: dict[str, dict[str, Any]]) -> list[dict[str, Any]]:
        gait = Solution.load(self.out / "gait.npz")
        rows = [
            gait_row(f"optimal, {_strides(each)}", each, done[stage], self.front)
            for each, stage in ((gait, "gait"), (self.best_gait, "front"))
        ]
        if "missing" not in done["swinging"]:
            swinging = Solution.load(self.out / "swinging.npz")
            name = "optimal while the pendulum swings"
            rows.append(gait_row(name, swinging, done["swinging"], self.front))
        return rows

    def _draw(self, rows: list[dict[str, Any]]) -> None:
        start = np.zeros(STATE_SIZE)
        start[MODE], start[PHI] = DOUBLE, self.params.constants.a
        clone, tuned = _learned(self.out / CLONED), _learned(self.out / TUNED)
        walks = {
            "imitation": record(self.params, clone, start, 20.0),
            "fine-tuned": record(self.params, tuned, start, 20.0),
        }
        plot_limit_cycles(self.out / "limit_cycles.png", self.best_gait, walks)
        points = {
            row["policy"]: (row["speed"], row["cot"])
            for row in rows
            if row["walking_share"] and row["cot"] is not None
        }
        plot_cot_against_speed(self.out / "cot_against_speed.png", self.front, points)
        first = walks["imitation"]
        clip = Walk(first.states[:700], first.voltages[:700], first.rows[:700])
        animate(self.out / "imitation.gif", self.params, clip, progress=self.progress)


def _learned(path: Path) -> Policy:
    return model_policy(load_policy(path).model)


def _strides(gait: Solution) -> str:
    return f"{gait.steps} step{'s' if gait.steps > 1 else ''} per stride"


def _gait_result(gait: Solution) -> dict[str, Any]:
    return {
        "cot": gait.cot,
        "speed": gait.speed,
        "theta_turns": gait.theta_turns,
        "verification": dataclasses.asdict(gait.verification),
    }


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
