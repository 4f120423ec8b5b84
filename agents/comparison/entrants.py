"""The entrants of a comparison: optimal gaits, feedback laws, trained learners.

`entrants` lists them. A feedback law in `trajopt/feedback/laws` enters by itself, unless it is
`LEFT_OUT`; a learner enters with one more `Learned` in that list.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Iterator
from typing import Protocol

from agents.comparison.arena import Arena, Result, Row
from agents.comparison.learned import Learned
from agents.comparison.report import gait_row
from agents.comparison.shipped import for_the_front, from_screened
from agents.comparison.study import Study
from agents.folder import BEST, CLONE, LAST
from agents.gaps import FRONT_STEPS
from agents.policies import controller_policy
from agents.train import EXPERT
from agents.training import IMITATION, SCRATCH
from rimless_gym.hybrid import CONTROL_PERIOD
from trajopt import NoGaitError, Solution, periodic_gait
from trajopt.feedback import laws
from trajopt.gaits.front_files import front_file
from trajopt.gaits.fronts import cot_front
from trajopt.gaits.shipped import leads_for

#: What the table calls feedback laws whose names are abbreviations.
ABBREVIATIONS = {"lqr": "LQR", "pid": "PD"}

#: Laws that take minutes to design or to walk the whole protocol: `scripts/feedback.py` has them.
LEFT_OUT = ("receding_horizon", "tuned")


class Entrant(Protocol):
    """What is compared. It competes in a stage of its own, perhaps in a process of its own."""

    @property
    def name(self) -> str:
        """Of its stage and of its files."""

    @property
    def after(self) -> tuple[str, ...]:
        """Names of the entrants whose results it needs."""

    @property
    def effort(self) -> float:
        """About how long it takes on one core (s): what takes long, or is waited for, is first."""

    def compete(self, arena: Arena) -> Result:
        """The result, plain values and arrays; "files", if there, names the files that it made."""

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """Its rows of the table, once all have competed."""


@dataclasses.dataclass(frozen=True)
class Gait:
    """An optimal gait at the study's speed.

    Attributes:
        name: of its stage and of its file.
        title: its row; None: its number of steps per stride.
        solve: finds it, or says why there is none.
        effort, after: see `Entrant`.
    """

    name: str
    title: str | None
    solve: Callable[[Arena], Solution | str]
    effort: float
    after: tuple[str, ...] = ()

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
        title = self.title or strides(gait)
        return [gait_row(title, gait, arena.gap(gait.cot, gait.speed), arena.study.speed)]


@dataclasses.dataclass(frozen=True)
class Front:
    """The front of optimal gaits. Its rows are those of the best ones at the study's speeds."""

    name: str = "front"
    effort: float = 50.0
    after: tuple[str, ...] = ()

    def compete(self, arena: Arena) -> Result:
        """Solve the gaits of the front that are not in the folder yet."""
        front = cot_front(
            arena.params,
            arena.study.front_speeds,
            FRONT_STEPS,
            folder=arena.out,
            progress=arena.progress,
        )
        names = [front_file(s.steps, s.speed) for s in front.solutions]
        gaits = [gait_result(s) | {"steps": s.steps} for s in front.solutions]
        return {"files": names, "gaits": gaits, "missing": [list(m) for m in front.missing]}

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """The rows of the best gaits at the study's speeds."""
        best = {speed: arena.best_gait(speed) for speed in arena.study.speeds}
        return [
            gait_row(strides(gait), gait, arena.gap(gait.cot, gait.speed), speed)
            for speed, gait in best.items()
        ]


@dataclasses.dataclass(frozen=True)
class HeldFront:
    """The environment's own optimum: the front of gaits whose voltage is held for its 10 ms.

    Each has the speed and the steps of a gait of the continuous front. Its rows are those of its
    gaits nearest to the study's speeds.
    """

    name: str = "held_front"
    effort: float = 20.0
    after: tuple[str, ...] = ("front",)

    def compete(self, arena: Arena) -> Result:
        """Solve the gaits of the front that are not in the folder yet."""
        best = arena.front.envelope
        solutions: list[Solution] = []
        missing: list[tuple[int, float, str]] = []
        for steps in sorted({gait.steps for gait in best}):
            speeds = [gait.speed for gait in best if gait.steps == steps]
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
        """The rows of the gaits nearest to the study's speeds."""
        title = f"optimal, voltage held for {1e3 * CONTROL_PERIOD:g} ms"
        best = {speed: arena.held_gait(speed) for speed in arena.study.speeds}
        return [
            gait_row(title, gait, arena.gap(gait.cot, gait.speed), speed)
            for speed, gait in best.items()
        ]


@dataclasses.dataclass(frozen=True)
class Law:
    """A feedback law that holds the environment's own best gait nearest to a speed.

    Attributes:
        name: of its stage.
        law: one of `trajopt.feedback.laws.names()`.
        speed: one of the study's (m/s).
        effort, after: see `Entrant`. The first law for a gait plans the catch for all.
    """

    name: str
    law: str
    speed: float
    effort: float
    after: tuple[str, ...]

    def compete(self, arena: Arena) -> Result:
        """Evaluate it."""
        controller = laws.design(self.law, arena.held_gait(self.speed), arena.out)
        return arena.evaluated(controller_policy(arena.params, controller))

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """Its row."""
        title = ABBREVIATIONS.get(self.law, self.law.replace("_", " "))
        return [arena.row(f"{title} about the optimum", result, self.speed)]


def entrants(study: Study) -> tuple[Entrant, ...]:
    """All entrants, in the order in which they stand in the table within their speed."""
    others = [name for name in laws.names() if name not in (*LEFT_OUT, EXPERT)]
    return (
        Gait("gait", None, _searched, effort=8.0),
        Front(),
        HeldFront(),
        Gait("swinging", "optimal while the pendulum swings", _swinging, effort=5.0),
        *(Law(name, name, study.speed, effort=8.0, after=(EXPERT,)) for name in others),
        *_holding(study),
        *for_the_front(study),
        Learned(
            "scratch",
            SCRATCH,
            {"PPO from scratch": BEST},
            effort=115.0,
            budget="scratch_timesteps",
            curve="PPO from scratch",
        ),
        *from_screened(study),
        Learned(
            "evolution",
            SCRATCH,
            {"evolution from scratch": BEST},
            effort=290.0,
            algo="evolution",
            budget="evolution_timesteps",
            drawn="evolution",
            curve="evolution from scratch",
        ),
        Learned(
            "distilled",
            IMITATION,
            {"evolution, distilled into a network": CLONE},
            effort=90.0,
            after=("evolution",),
            teacher=f"evolution/{BEST}",
        ),
    )


def _holding(study: Study) -> Iterator[Entrant]:
    """The best law at every speed, its clone, and the clone fine-tuned."""
    for speed in study.speeds:
        main = speed == study.speed
        end = "" if main else f"_{speed:g}"
        law, cloned, tuned = f"{EXPERT}{end}", f"imitation{end}", f"fine_tuned{end}"
        yield Law(law, EXPERT, speed, effort=35.0, after=("held_front",))
        yield Learned(
            cloned,
            IMITATION,
            {"imitation": CLONE},
            effort=85.0,
            after=(law,),
            speed=speed,
            drawn="imitation" if main else None,
        )
        if main or study.further_timesteps:
            best = {"fine-tuned, best kept": BEST}
            yield Learned(
                tuned,
                f"{cloned}/{CLONE}",
                best | {"fine-tuned, last": LAST} if main else best,
                effort=50.0,
                after=(cloned,),
                speed=speed,
                budget="timesteps" if main else "further_timesteps",
                drawn="fine-tuned" if main else None,
                curve="fine-tuned" if main else None,
            )


def _searched(arena: Arena) -> Solution:
    """The study's gait, searched for from a shipped guess and from random starts."""
    study = arena.study
    return periodic_gait(
        arena.params,
        study.on_tick(study.speed),
        study.steps,
        starts=study.starts,
        seed=study.seed,
        workers=os.cpu_count() or 1,
        progress=arena.progress,
    )


def _swinging(arena: Arena) -> Solution | str:
    """The best gait whose pendulum does not whirl, where one is shipped to start from."""
    study = arena.study
    speed = study.on_tick(study.speed)
    known = leads_for(arena.params, speed, study.steps)
    swinging = [gait for gait in known if gait.theta_turns == 0 and gait.params == arena.params]
    if not swinging:
        return f"no swinging gait of {study.steps} steps is shipped for this machine"
    try:
        return periodic_gait(arena.params, speed, study.steps, guess=swinging[0])
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
