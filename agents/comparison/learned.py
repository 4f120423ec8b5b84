"""Trained learners as entrants of a comparison."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from agents.comparison.arena import Arena, Result, Row
from agents.comparison.report import policy_row
from agents.policies import learned_policy
from agents.policy_files import load_policy
from agents.train import EXPERT, train
from agents.training import IMITATION, INITS
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
        algo: the learner.
        budget: the field of the study that has its control intervals; None: it is not trained.
        drawn: what the plot of limit cycles calls its main policy; None: it is not drawn.
        teacher: a policy's file in the study's folder that is imitated; None: the usual expert is.
    """

    name: str
    init: str
    shown: dict[str, str]
    algo: str = "ppo"
    budget: str | None = "timesteps"
    drawn: str | None = None
    teacher: str | None = None

    def compete(self, arena: Arena) -> Result:
        """Train and evaluate it."""
        trained = train(
            self.algo,
            self.init if self.init in INITS else arena.out / self.init,
            arena.study.seed,
            arena.out / self.name,
            timesteps=0 if self.budget is None else getattr(arena.study, self.budget),
            params=arena.params,
            expert=self._expert(arena),
            progress=arena.progress,
        )
        if trained.interrupted:
            raise KeyboardInterrupt
        files = [f"{self.name}/{file}" for file in self.shown.values()]
        evaluated = {
            Path(file).stem: arena.evaluated(learned_policy(load_policy(arena.out / file).act))
            for file in files
        }
        main = evaluated.pop(Path(files[0]).stem)
        return main | evaluated | {"timesteps": trained.timesteps, "files": files}

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """A row for each policy shown."""
        (main, _), *others = self.shown.items()
        return [
            policy_row(main, result, arena.held_front),
            *(
                policy_row(title, result | result[Path(file).stem], arena.held_front)
                for title, file in others
            ),
        ]

    def _expert(self, arena: Arena) -> Controller | str:
        """What it imitates, if it does."""
        if self.teacher is not None:
            return str(arena.out / self.teacher)
        return laws.design(EXPERT, arena.held_gait) if self.init == IMITATION else EXPERT

    def main_file(self, out: Path) -> Path:
        """The file of its main policy in a study's folder."""
        return out / self.name / next(iter(self.shown.values()))
