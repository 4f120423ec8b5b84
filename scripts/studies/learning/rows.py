"""The rows of the study. One more learner is one more entry in `ROWS`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from agents.comparison.table import EVOLVED, FRONT_TUNED, PPO_PRIOR, SAC_PRIOR
from agents.evaluate import COMMANDS
from agents.learner import BEST, CLONE, IMITATION, LAST, SCRATCH
from agents.prior import LAW
from rimless_gym.envs.speed import PERIOD
from scripts.studies.learning.trials import Following, Other, StudyRow, Trained

#: The tables of the page: policies for `RimlessWheel-v0`; those that follow commands as efficiently
#: as the front allows; and those of plain stable-baselines3 for commanded speeds.
SECTIONS = ("learned", "front", "first_evening")
LEARNED, FRONT, FIRST_EVENING = SECTIONS

#: What distinguishes a policy -> its file: of a training, and of one that ends with the clone.
KEPT = {"best kept": BEST, "last": LAST}
CLONED = {"": CLONE}
LAST_ONLY, BEST_ONLY = {"": LAST}, {"": BEST}

#: Time steps of CMA-ES from a policy that costs twice the optimum.
LONG = 200_000_000

#: Of the policies for the front: between which speeds one is commanded in training, and those that
#: are commanded in the evaluation.
COMMANDED: Mapping[str, Any] = {
    "speeds": (0.5, 0.63),
    "commands": (0.51, 0.52, 0.54, 0.56, 0.58, 0.6, 0.62, 0.63),
    "changes": (0.56, 0.62, 0.52, 0.6, 0.54, 0.58),
}

#: Rows whose policies others need.
IMITATED = StudyRow(
    "imitation", "imitation of the LQR", LEARNED, Trained("ppo", IMITATION, 0, CLONED)
)
EVOLUTION = StudyRow(
    "evolution", "evolution from scratch", LEARNED, Trained("evolution", files=KEPT)
)
DISTILLED = StudyRow(
    "distilled",
    "evolution with a start-up controller, distilled",
    LEARNED,
    Trained("ppo", IMITATION, 0, CLONED, expert=Other(EVOLUTION, BEST), startup=True),
)
WITH_PRIOR = StudyRow(
    "ppo_prior",
    "PPO with the law as prior",
    LEARNED,
    Trained("ppo", files=LAST_ONLY, prior=LAW),
)
SAC_WITH_PRIOR = StudyRow(
    "sac_prior",
    "SAC with the law as prior",
    LEARNED,
    Trained("sac", files=LAST_ONLY, prior=LAW),
)
SAC_DISTILLED = StudyRow(
    "sac_distilled",
    "SAC with the law as prior, distilled",
    LEARNED,
    Trained("ppo", IMITATION, 0, CLONED, expert=Other(SAC_WITH_PRIOR, LAST)),
)
SCHEDULE = StudyRow(
    "front",
    "imitation of a gain schedule",
    FRONT,
    Following(
        "ppo",
        IMITATION,
        0,
        CLONED,
        cloning={
            "starts": 1024,
            "lost_labels": 60_000,
            "gait_starts": 256,
            "gait_labels": 80_000,
            "gradient_steps": 9000,
            "batch_size": 1024,
        },
        **COMMANDED,
    ),
)

ROWS = (
    IMITATED,
    StudyRow(
        "fine_tuned",
        "imitation, fine-tuned by CMA-ES",
        LEARNED,
        Trained("cma_es", IMITATION, None, LAST_ONLY, start=Other(IMITATED, CLONE)),
    ),
    StudyRow(
        "gradients",
        "imitation, fine-tuned by gradients",
        LEARNED,
        Trained("gradients", IMITATION, None, LAST_ONLY, start=Other(IMITATED, CLONE)),
    ),
    StudyRow("ppo", "PPO from scratch", LEARNED, Trained("ppo", files=KEPT)),
    StudyRow("sac", "SAC from scratch", LEARNED, Trained("sac", files=KEPT)),
    WITH_PRIOR,
    StudyRow(
        "ppo_prior_cma_es",
        PPO_PRIOR,
        LEARNED,
        Trained("cma_es", IMITATION, None, LAST_ONLY, start=Other(WITH_PRIOR, LAST)),
    ),
    SAC_WITH_PRIOR,
    SAC_DISTILLED,
    StudyRow(
        "sac_prior_cma_es",
        SAC_PRIOR,
        LEARNED,
        Trained("cma_es", IMITATION, LONG, LAST_ONLY, start=Other(SAC_DISTILLED, CLONE)),
    ),
    EVOLUTION,
    DISTILLED,
    StudyRow(
        "evolution_cma_es",
        EVOLVED,
        LEARNED,
        Trained(
            *("cma_es", IMITATION, None, BEST_ONLY),
            start=Other(DISTILLED, CLONE),
            hyperparameters={"return_weight": 1.0},
        ),
    ),
    SCHEDULE,
    StudyRow(
        "front_cma_es",
        FRONT_TUNED,
        FRONT,
        Following("cma_es", IMITATION, None, LAST_ONLY, start=Other(SCHEDULE, CLONE), **COMMANDED),
    ),
    StudyRow(
        "first_evening",
        "PPO of stable-baselines3",
        FIRST_EVENING,
        Following("ppo", SCRATCH, 500_000, LAST_ONLY, commands=COMMANDS, period=PERIOD),
        enough=0.8,
    ),
)
