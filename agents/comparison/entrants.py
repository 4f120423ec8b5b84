"""The entrants of a comparison: optimal gaits, feedback laws, trained learners.

`entrants()` lists them in the order of the table. A feedback law in `trajopt/feedback/laws` enters
by itself, unless it is `LEFT_OUT`; a learner enters with one more `Learned` in that list.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable
from typing import Protocol

from agents.comparison.arena import Arena, Result, Row
from agents.comparison.learned import Learned
from agents.comparison.report import gait_row, policy_row
from agents.folder import BEST, CLONE, LAST
from agents.policies import controller_policy
from agents.training import IMITATION, SCRATCH
from rimless_gym.hybrid import CONTROL_PERIOD
from trajopt import NoGaitError, Solution, periodic_gait
from trajopt.feedback import laws
from trajopt.gaits.front_files import front_file
from trajopt.gaits.fronts import cot_front
from trajopt.gaits.held.clock import held_speeds
from trajopt.gaits.shipped import leads_for

#: Strides considered for the optimal front.
FRONT_STEPS = (1, 2, 3)

#: What the table calls feedback laws whose names are abbreviations.
ABBREVIATIONS = {"lqr": "LQR", "pid": "PD"}

#: Laws that take minutes to design or to walk the whole protocol: `scripts/feedback.py` has them.
LEFT_OUT = ("receding_horizon", "tuned")


class Entrant(Protocol):
    """What is compared. It competes in a stage of its own."""

    @property
    def name(self) -> str:
        """Of its stage and of its files."""

    def compete(self, arena: Arena) -> Result:
        """The result, plain values and arrays; "files", if there, names the files that it made."""

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """Its rows of the table, once all have competed."""


@dataclasses.dataclass(frozen=True)
class Gait:
    """An optimal gait.

    Attributes:
        name: of its stage and of its file.
        title: its row; None: its number of steps per stride.
        solve: finds it, or says why there is none.
    """

    name: str
    title: str | None
    solve: Callable[[Arena], Solution | str]

    def compete(self, arena: Arena) -> Result:
        """Solve it, or say why there is none."""
        gait = self.solve(arena)
        if isinstance(gait, str):
            return {"missing": gait}
        if not gait.verification.passed:
            return {"missing": "; ".join(gait.verification.failures)}
        gait.save(arena.out / f"{self.name}.npz")
        return gait_result(gait) | {"files": [f"{self.name}.npz"]}

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """Its row, if there is one."""
        if "missing" in result:
            return []
        gait = Solution.load(arena.out / f"{self.name}.npz")
        return [gait_row(self.title or strides(gait), gait, result, arena.held_front)]


@dataclasses.dataclass(frozen=True)
class Front:
    """The front of optimal gaits around the study's speed. Its row is that of the best one."""

    name: str = "front"

    def compete(self, arena: Arena) -> Result:
        """Solve the gaits of the front that are not in the folder yet."""
        speeds = sorted({*arena.study.front, arena.study.speed})
        front = cot_front(
            arena.params, speeds, FRONT_STEPS, folder=arena.out, progress=arena.progress
        )
        names = [front_file(s.steps, s.speed) for s in front.solutions]
        gaits = [gait_result(s) | {"steps": s.steps} for s in front.solutions]
        return {"files": names, "gaits": gaits, "missing": [list(m) for m in front.missing]}

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """The row of the best gait at the study's speed."""
        best = arena.best_gait
        return [gait_row(strides(best), best, result, arena.held_front)]


@dataclasses.dataclass(frozen=True)
class HeldFront:
    """The environment's own optimum: the front of gaits whose voltage is held for its 10 ms.

    It has every speed of the front at which a step lasts a whole number of control intervals. Its
    gaits have as many steps as the continuous front's nearest in speed. Its row is that of its
    gait nearest to the study's speed.
    """

    name: str = "held_front"

    def compete(self, arena: Arena) -> Result:
        """Solve the gaits of the front that are not in the folder yet."""
        best = arena.front.envelope
        solutions: list[Solution] = []
        missing: list[tuple[int, float, str]] = []
        for steps in sorted({gait.steps for gait in best}):
            own = [gait.speed for gait in best if gait.steps == steps]
            speeds = held_speeds(arena.params, min(own), max(own), CONTROL_PERIOD)
            try:
                front = cot_front(
                    arena.params,
                    speeds,
                    [steps],
                    hold=CONTROL_PERIOD,
                    folder=arena.out,
                    progress=arena.progress,
                )
            except NoGaitError as error:
                missing += [(steps, speed, str(error)) for speed in speeds]
                continue
            solutions += front.solutions
            missing += front.missing
        if not solutions:
            raise NoGaitError("\n".join(why for _, _, why in missing))
        names = [front_file(s.steps, s.speed, s.hold) for s in solutions]
        results = [gait_result(s) | {"steps": s.steps} for s in solutions]
        return {"files": names, "gaits": results, "missing": [list(m) for m in missing]}

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """The row of the gait nearest to the study's speed."""
        title = f"optimal, voltage held for {1e3 * CONTROL_PERIOD:g} ms"
        return [gait_row(title, arena.held_gait, result, arena.held_front)]


@dataclasses.dataclass(frozen=True)
class Law:
    """A feedback law that holds the environment's own best gait nearest to the study's speed.

    Attributes:
        name: one of `trajopt.feedback.laws.names()`.
    """

    name: str

    def compete(self, arena: Arena) -> Result:
        """Evaluate it."""
        controller = laws.design(self.name, arena.held_gait)
        return arena.evaluated(controller_policy(arena.params, controller))

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """Its row."""
        title = ABBREVIATIONS.get(self.name, self.name.replace("_", " "))
        return [policy_row(f"{title} about the optimum", result, arena.held_front)]


def entrants() -> tuple[Entrant, ...]:
    """All entrants, in the order in which they compete and stand in the table."""
    return (
        Gait("gait", None, _searched),
        Front(),
        HeldFront(),
        Gait("swinging", "optimal while the pendulum swings", _swinging),
        *(Law(name) for name in laws.names() if name not in LEFT_OUT),
        Learned("imitation", IMITATION, {"imitation": CLONE}, budget=None, drawn="imitation"),
        Learned(
            "fine_tuned",
            f"imitation/{CLONE}",
            {"fine-tuned, best kept": BEST, "fine-tuned, last": LAST},
            drawn="fine-tuned",
        ),
        Learned("scratch", SCRATCH, {"PPO from scratch": BEST}, budget="scratch_timesteps"),
        Learned(
            "evolution",
            SCRATCH,
            {"evolution from scratch": BEST},
            algo="evolution",
            budget="evolution_timesteps",
            drawn="evolution",
        ),
        Learned(
            "distilled",
            IMITATION,
            {"evolution, distilled into a network": CLONE},
            budget=None,
            teacher=f"evolution/{BEST}",
        ),
    )


def _searched(arena: Arena) -> Solution:
    """The study's gait, searched for from a shipped guess and from random starts."""
    study = arena.study
    return periodic_gait(
        arena.params,
        study.speed,
        study.steps,
        starts=study.starts,
        seed=study.seed,
        workers=os.cpu_count() or 1,
        progress=arena.progress,
    )


def _swinging(arena: Arena) -> Solution | str:
    """The best gait whose pendulum does not whirl, where one is shipped to start from."""
    study = arena.study
    known = leads_for(arena.params, study.speed, study.steps)
    swinging = [gait for gait in known if gait.theta_turns == 0 and gait.params == arena.params]
    if not swinging:
        return f"no swinging gait of {study.steps} steps is shipped for this machine"
    try:
        return periodic_gait(arena.params, study.speed, study.steps, guess=swinging[0])
    except NoGaitError as error:
        return str(error)


def strides(gait: Solution) -> str:
    """The title of an optimal gait."""
    return f"optimal, {gait.steps} step{'s' if gait.steps > 1 else ''} per stride"


def gait_result(gait: Solution) -> Result:
    """What is told of an optimal gait."""
    return {
        "cot": gait.cot,
        "speed": gait.speed,
        "theta_turns": gait.theta_turns,
        "verification": dataclasses.asdict(gait.verification),
    }
