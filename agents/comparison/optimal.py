"""Optimal gaits as entrants of a comparison: those of the study, the front, the held front."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from agents.comparison.arena import Arena, Result, Row
from agents.comparison.report import gait_row
from rimless_gym.hybrid import CONTROL_PERIOD
from trajopt import NoGaitError, Solution, periodic_gait
from trajopt.gaits.fronts import cot_front, front_file
from trajopt.gaits.library import warm_starts
from trajopt.processes import cores


@dataclasses.dataclass(frozen=True)
class Gait:
    """An optimal gait at the study's speed.

    Attributes:
        name: of its stage and of its file.
        title: its row; None: its number of steps per stride.
        solve: finds it, or says why there is none.
        effort, after: see `agents.comparison.entrants.Entrant`.
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
            arena.study.front_steps,
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


def searched(arena: Arena) -> Solution:
    """The study's gait, searched for from a shipped guess and from random starts."""
    study = arena.study
    return periodic_gait(
        arena.params,
        study.on_tick(study.speed),
        study.steps,
        starts=study.starts,
        seed=study.seed,
        workers=cores(),
        progress=arena.progress,
    )


def swinging(arena: Arena) -> Solution | str:
    """The best gait whose pendulum does not whirl, where one is shipped to start from."""
    study = arena.study
    speed = study.on_tick(study.speed)
    known = warm_starts(arena.params, speed, study.steps)
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
