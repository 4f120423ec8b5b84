"""The headline: learned against optimal cost of transport, on one model, at equal speed.

A study runs in stages, each of which leaves its result in the study's folder; running the same
study again goes on after the last finished stage.
"""

from __future__ import annotations

import dataclasses
import json
import os
import time
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from agents.checkpoint import load_checkpoint
from agents.evaluate import Evaluation, evaluate
from agents.expert import Guarded, gait_expert
from agents.figures import Walk, animate, plot_cot_against_speed, plot_limit_cycles, record
from agents.policies import Policy, controller_policy, model_policy
from agents.report import format_table, gait_row, policy_row
from agents.train import train
from rimless_gym.hybrid import DOUBLE
from rimless_gym.params import WheelParams, preset
from rimless_gym.stepping import MODE, PHI, STATE_SIZE
from trajopt import NoGaitError, Solution, periodic_gait
from trajopt.fronts import CotFront, cot_front
from trajopt.guesses import leads_for
from trajopt.provenance import provenance

#: Strides considered for the optimal front.
FRONT_STEPS = (1, 2, 3)


@dataclasses.dataclass(frozen=True)
class Study:
    """What is compared.

    Attributes:
        preset: name of the machine.
        speed: at which the gait to imitate is optimal (m/s).
        steps: of the gait that is solved for and reported beside the front's best.
        seed: of everything random.
        timesteps: control intervals of fine-tuning, and of training from scratch.
        starts: random starts of the search for the gait, beside the shipped guess.
        front: speeds at which the optimal front is solved (m/s), enclosing the learned ones.
    """

    preset: str = "THESIS_PHYSICAL"
    speed: float = 0.5
    steps: int = 2
    seed: int = 0
    timesteps: int = 600_000
    starts: int = 4
    front: tuple[float, ...] = (0.40, 0.45, 0.50, 0.525, 0.55, 0.57, 0.58, 0.59, 0.60)

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return preset(self.preset)


class Comparison:
    """A study in a folder.

    Args:
        study: what to compare.
        out: folder; may hold the same study, finished or not.
        progress: whether to show progress bars.

    Raises:
        ValueError: the preset is unknown, or the folder holds another study.
    """

    def __init__(self, study: Study, out: Path, progress: bool = True) -> None:
        self.study, self.out, self.progress = study, out, progress
        self.params = study.params
        wanted = json.loads(json.dumps(dataclasses.asdict(study)))
        written = out / "study.json"
        if written.exists():
            has = json.loads(written.read_text())["study"]
            differing = {
                k: f"{has.get(k)} (not {wanted[k]})" for k in wanted if has.get(k) != wanted[k]
            }
            if differing:
                raise ValueError(
                    f"{out} holds another study: {differing}; choose another --out, or remove it"
                )
        out.mkdir(parents=True, exist_ok=True)
        _write_json(written, {"study": wanted} | provenance())

    def run(self) -> dict[str, Any]:
        """Run what is not done yet; the results, which also stand in results.json."""
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
        bar = tqdm(stages.items(), desc="compare", unit="stage", disable=not self.progress)
        for name, work in bar:
            bar.set_postfix_str(name)
            done[name] = self._stage(name, work)
        return self._report(done)

    def _stage(self, name: str, work: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """The result of a stage, from its file if it has been run."""
        file = self.out / f"{name}.json"
        if not file.exists():
            began = time.perf_counter()
            result = work()
            _write_json(file, result | {"wall_time_s": round(time.perf_counter() - began, 1)})
        return dict(json.loads(file.read_text()))

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
        return _gait_result(gait)

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
        return _gait_result(gait)

    def _solve_front(self) -> dict[str, Any]:
        speeds = sorted({*self.study.front, self.study.speed})
        front = cot_front(self.params, speeds, FRONT_STEPS, progress=self.progress)
        names = []
        for solution in front.solutions:
            names.append(f"front_{solution.steps}_steps_{solution.speed:.3f}.npz")
            solution.save(self.out / names[-1])
        gaits = [_gait_result(s) | {"steps": s.steps} for s in front.solutions]
        return {"files": names, "gaits": gaits, "missing": [list(m) for m in front.missing]}

    def _evaluate_lqr(self) -> dict[str, Any]:
        policy = controller_policy(self.params, self.expert)
        return self._evaluated(policy)

    def _imitate(self) -> dict[str, Any]:
        result = self._trained("imitation", "imitation", 0)
        clone = self.out / "imitation" / "clone.zip"
        return self._evaluated(_learned(clone)) | result | {"policy": str(clone.name)}

    def _fine_tune(self) -> dict[str, Any]:
        clone = self.out / "imitation" / "clone.zip"
        result = self._trained("fine_tuned", clone, self.study.timesteps)
        last = self._evaluated(_learned(self.out / "fine_tuned" / "last.zip"))
        best = self._evaluated(_learned(self.out / "fine_tuned" / "best.zip"))
        return best | result | {"last": last}

    def _train_from_scratch(self) -> dict[str, Any]:
        result = self._trained("scratch", "scratch", self.study.timesteps)
        return self._evaluated(_learned(self.out / "scratch" / "best.zip")) | result

    def _trained(self, name: str, init: str | Path, timesteps: int) -> dict[str, Any]:
        folder = self.out / name
        resume = (folder / "last.zip").exists()
        result = train(
            "ppo",
            init,
            self.study.seed,
            folder,
            timesteps=timesteps,
            resume=resume,
            params=self.params,
            expert=self.expert,
            progress=self.progress,
        )
        if result.interrupted:
            raise KeyboardInterrupt
        return {"timesteps": result.timesteps, "resumed": resume}

    def _evaluated(self, policy: Policy) -> dict[str, Any]:
        evaluation: Evaluation = evaluate(policy, self.params, progress=self.progress)
        return {"evaluation": evaluation.to_dict()}

    # -- what the stages share ------------------------------------------------------------------

    @cached_property
    def front(self) -> CotFront:
        """The optimal front, as the stage left it."""
        names = json.loads((self.out / "front.json").read_text())["files"]
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
        return min((s for s in at_speed if s.cot < 1.0001 * lowest), key=lambda s: s.steps)

    @cached_property
    def expert(self) -> Guarded:
        """The feedback law that holds it."""
        return gait_expert(self.best_gait)

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
        (self.out / "table.md").write_text(format_table(rows) + "\n")
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
        clone = _learned(self.out / "imitation" / "clone.zip")
        tuned = _learned(self.out / "fine_tuned" / "best.zip")
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
    return model_policy(load_checkpoint(path).model)


def _strides(gait: Solution) -> str:
    return f"{gait.steps} step{'s' if gait.steps > 1 else ''} per stride"


def _gait_result(gait: Solution) -> dict[str, Any]:
    return {
        "cot": gait.cot,
        "speed": gait.speed,
        "theta_turns": gait.theta_turns,
        "verification": dataclasses.asdict(gait.verification),
    }


def _write_json(path: Path, values: Any) -> None:
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps(values, indent=1, default=_plain) + "\n")
    os.replace(part, path)


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{value!r} is not a JSON value")
