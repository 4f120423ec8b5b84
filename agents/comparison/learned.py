"""Trained learners as entrants of a comparison."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from agents.comparison.arena import Arena, Result, Row
from agents.experts import EXPERT
from agents.learner import IMITATION, INITS
from agents.policy_files import load_policy
from agents.training import TrainingConfig, train
from trajopt.feedback import laws
from trajopt.feedback.law import Controller


@dataclasses.dataclass(frozen=True)
class Learned:
    """A learner's policies.

    Attributes:
        name: of its stage and of the folder of its training.
        init: "scratch", "imitation", or a policy's file in the study's folder.
        shown: title of a row -> the policy's file in the training's folder; the first is the main
            one.
        effort: about how long it takes on one core (s).
        after: names of the entrants whose results it needs.
        algo: the learner.
        speed: the study's speed that it walks at (m/s); None: it chooses its speed itself.
        budget: the field of the study that has its control intervals; None: it is not trained.
        drawn: what the plot of limit cycles calls its main policy; None: it is not drawn.
        curve: what the plot of learning curves calls it; None: it is not drawn.
        teacher: a policy's file in the study's folder that is imitated; None: the usual expert is.
    """

    name: str
    init: str
    shown: dict[str, str]
    effort: float = 60.0
    after: tuple[str, ...] = ()
    algo: str = "ppo"
    speed: float | None = None
    budget: str | None = None
    drawn: str | None = None
    curve: str | None = None
    teacher: str | None = None

    def compete(self, arena: Arena) -> Result:
        """Train and evaluate it."""
        config = TrainingConfig(
            self.algo,
            self.init if self.init in INITS else str(arena.out / self.init),
            arena.study.seed,
            timesteps=0 if self.budget is None else getattr(arena.study, self.budget),
            params=arena.params,
            expert=self._expert(arena),
        )
        trained = train(config, arena.out / self.name, progress=arena.progress)
        files = [f"{self.name}/{file}" for file in self.shown.values()]
        evaluated = {
            Path(file).stem: arena.evaluated(load_policy(arena.out / file).policy) for file in files
        }
        main = evaluated.pop(Path(files[0]).stem)
        curve = [dataclasses.asdict(milestone) for milestone in trained.curve]
        return main | evaluated | {"timesteps": trained.timesteps, "curve": curve, "files": files}

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """A row for each policy shown."""
        (main, _), *others = self.shown.items()
        own = {main: result} | {title: result | result[Path(file).stem] for title, file in others}
        return [arena.row(title, of, self.speed) for title, of in own.items()]

    def _expert(self, arena: Arena) -> Controller | str:
        """What it imitates, if it does."""
        if self.teacher is not None:
            return str(arena.out / self.teacher)
        if self.init != IMITATION:
            return EXPERT
        gait = arena.held_gait(arena.study.speed if self.speed is None else self.speed)
        return laws.design(EXPERT, gait, arena.out)

    def main_file(self, out: Path) -> Path:
        """The file of its main policy in a study's folder."""
        return out / self.name / next(iter(self.shown.values()))


def learning_curve(learned: Learned, results: Mapping[str, Result]) -> list[dict[str, Any]]:
    """The milestones of a training. Their minutes include those of the trainings it began from.

    Args:
        learned: whose.
        results: of all stages, by name.
    """
    before = [results[name]["curve"] for name in learned.after if "curve" in results[name]]
    minutes = sum(curve[-1]["minutes"] for curve in before)
    own: list[dict[str, Any]] = results[learned.name]["curve"]
    return [each | {"minutes": minutes + each["minutes"]} for each in own]
