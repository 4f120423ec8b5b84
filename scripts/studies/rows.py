"""The rows of the study. One more learner is one more entry in `ROWS`."""

from __future__ import annotations

import dataclasses

from agents.folder import BEST, CLONE, LAST
from agents.training import IMITATION
from scripts.studies.first_evening import FirstEvening
from scripts.studies.trials import Distilled, Trained, Trial

#: The tables of the page: policies for `RimlessWheel-v0`, and those for commanded speeds.
LEARNED, FIRST_EVENING = "learned", "first_evening"


@dataclasses.dataclass(frozen=True)
class Row:
    """A way to learn, over several seeds.

    Attributes:
        name: of its files, and on the command line.
        title: in the table.
        table: in which it stands, `LEARNED` or `FIRST_EVENING`.
        trial: how a seed is trained and judged.
        enough: a seed walks if this share of its starts does.
        minutes: that a seed takes, about, before one has been timed.
    """

    name: str
    title: str
    table: str
    trial: Trial
    enough: float = 0.95
    minutes: float = 5.0


ROWS = (
    Row(
        "imitation",
        "imitation of the LQR",
        LEARNED,
        Trained("ppo", IMITATION, 0, (("", CLONE),)),
        minutes=1.5,
    ),
    Row(
        "fine_tuned",
        "fine-tuned by PPO",
        LEARNED,
        Trained("ppo", IMITATION, 600_000, (("best kept", BEST), ("last", LAST))),
        minutes=4.0,
    ),
    Row(
        "ppo",
        "PPO from scratch",
        LEARNED,
        Trained("ppo", judged=(("best kept", BEST), ("last", LAST))),
        minutes=4.0,
    ),
    Row(
        "evolution",
        "evolution from scratch",
        LEARNED,
        Trained("evolution", judged=(("best kept", BEST), ("last", LAST))),
        minutes=15.0,
    ),
    Row(
        "distilled",
        "evolution distilled into a network",
        LEARNED,
        Distilled("ppo", IMITATION, 0, (("", CLONE),), teacher="evolution"),
        minutes=2.0,
    ),
    Row(
        "first_evening",
        "PPO of stable-baselines3",
        FIRST_EVENING,
        FirstEvening("PPO", n_envs=8, timesteps=500_000),
        enough=0.8,
        minutes=6.0,
    ),
)
