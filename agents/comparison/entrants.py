"""The entrants of a comparison: optimal gaits, feedback laws, trained learners.

`entrants` lists them. A feedback law in `trajopt/feedback/laws` enters by itself, unless it is one
of `laws.SLOW`, which `scripts.studies feedback` measures. A learner enters with one more `Learned`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Protocol

from agents.comparison.arena import Arena, Result, Row
from agents.comparison.learned import Learned
from agents.comparison.optimal import Front, Gait, HeldFront, searched, swinging
from agents.comparison.shipped import for_the_front, from_screened
from agents.comparison.study import Study
from agents.experts import EXPERT
from agents.law_names import law_title
from agents.learner import BEST, CLONE, IMITATION, LAST, SCRATCH
from agents.policies import controller_policy
from trajopt.feedback import laws


class Entrant(Protocol):
    """What is compared. It competes in a stage of its own, perhaps in a process of its own."""

    @property
    def name(self) -> str:
        """Name of its stage and of its files."""

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
class Law:
    """A feedback law that holds the environment's own best gait nearest to a speed.

    Attributes:
        name: of its stage.
        law: one of `trajopt.feedback.laws.names()`.
        speed: one of the study's (m/s).
        effort, after: see `Entrant`. The first law for a gait computes what starts up all.
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
        title = f"{law_title(self.law)} about the optimum"
        return [arena.row(title, result, self.speed)]


def entrants(study: Study) -> tuple[Entrant, ...]:
    """All entrants, in the order in which they stand in the table within their speed."""
    others = [name for name in laws.names() if name not in (*laws.SLOW, EXPERT)]
    return (
        Gait("gait", None, searched, effort=8.0),
        Front(),
        HeldFront(),
        Gait("swinging", "optimal while the pendulum swings", swinging, effort=5.0),
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
