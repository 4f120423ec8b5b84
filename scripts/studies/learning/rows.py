"""The rows of the study. One more learner is one more entry in `ROWS`."""

from __future__ import annotations

from typing import Any

from agents.learner import BEST, CLONE, IMITATION, LAST, SCRATCH, learner_class
from rimless_gym.envs.task import USUAL_TASK
from scripts.studies.feedback_laws.measures import NOISE
from scripts.studies.learning.trials import Disturbed, Following, Other, PlainPpo, StudyRow, Trained

#: The tables of the page: policies for `RimlessWheel-v0`; ablations of PPO's reward weight and
#: of cloning; those that follow commands as efficiently as the front
#: allows; those that learned under disturbances; and those of plain stable-baselines3 for commanded
#: speeds.
SECTIONS = ("learned", "ablations", "front", "disturbed", "first_evening")
LEARNED, ABLATIONS, FRONT, DISTURBED, FIRST_EVENING = SECTIONS

#: What distinguishes a policy -> its file: of a training, and of one that ends with the clone.
KEPT = {"best kept": BEST, "last": LAST}
CLONED = {"": CLONE}
BEST_ONLY = {"": BEST}

#: Demonstrations alone: one round, with as many labels and gradient steps as DAgger's eight.
DEMONSTRATIONS = {"rounds": 1, "expert_starts": 1044, "gradient_steps": 6750}

#: Hyperparameters of a fine-tuning that changes more than the learner's own do.
LARGE_BATCHES = {"n_envs": 512, "n_steps": 128, "batch_size": 16384, "learning_rate": 5e-5}

#: The task's own weight and penalties, in place of those that training usually has.
OWN_WEIGHT = {
    "first_weight": USUAL_TASK.distance_weight,
    "fall_penalty": USUAL_TASK.fall_penalty,
    "slip_penalty": USUAL_TASK.slip_penalty,
}

#: Standard deviations of the sensors' errors (rad, rad/s): `noise x 2` of docs/feedback.md.
TWICE_THE_NOISE = {name: 2 * deviation for name, deviation in NOISE.items()}


def _adaptive(**changes: float) -> dict[str, Any]:
    """Hyperparameters of PPO from scratch with another `WeightSchedule`."""
    (callback,) = learner_class("ppo").settings(SCRATCH).written["callback"]
    return {"callback": [{name: usual | changes for name, usual in callback.items()}]}


#: Rows whose policies others need.
IMITATED = StudyRow(
    "imitation", "imitation of the LQR", LEARNED, Trained("ppo", IMITATION, 0, CLONED)
)
EVOLVED = StudyRow("evolution", "evolution from scratch", LEARNED, Trained("evolution", files=KEPT))
DISTILLED = StudyRow(
    "distilled",
    "evolution distilled into a network",
    LEARNED,
    Trained("ppo", IMITATION, 0, CLONED, expert=Other(EVOLVED, BEST)),
)
WEIGHT_STAYS = StudyRow(
    "weight_stays",
    "a reward weight of 5 that never falls",
    ABLATIONS,
    Trained("ppo", files=BEST_ONLY, hyperparameters=_adaptive(least_weight=5.0)),
)

ROWS = (
    IMITATED,
    StudyRow(
        "fine_tuned",
        "imitation, fine-tuned by CMA-ES",
        LEARNED,
        Trained("cma_es", IMITATION, None, BEST_ONLY, start=Other(IMITATED, CLONE)),
    ),
    StudyRow("ppo", "PPO from scratch", LEARNED, Trained("ppo", files=KEPT)),
    StudyRow(
        "screened_ppo", "PPO from screened policies", LEARNED, Trained("screened_ppo", files=KEPT)
    ),
    EVOLVED,
    DISTILLED,
    StudyRow(
        "weight_true",
        "the task's own weight, 0.5, and its penalties",
        ABLATIONS,
        Trained("ppo", files=BEST_ONLY, hyperparameters=_adaptive(**OWN_WEIGHT)),
    ),
    WEIGHT_STAYS,
    StudyRow(
        "weight_any_speed",
        "a reward weight of 5 that never falls, at any speed",
        ABLATIONS,
        Trained(
            "ppo",
            files=BEST_ONLY,
            hyperparameters=_adaptive(least_weight=5.0, rewarded_speed=100.0),
        ),
    ),
    StudyRow(
        "weight_drops",
        "a reward weight of 5 that never falls, then the task's own at once",
        ABLATIONS,
        Trained(
            "ppo",
            SCRATCH,
            None,
            BEST_ONLY,
            start=Other(WEIGHT_STAYS, LAST),
            hyperparameters=_adaptive(**OWN_WEIGHT),
        ),
    ),
    StudyRow(
        "clone_few_labels",
        "8,000 labels of start-up states a round instead of 60,000",
        ABLATIONS,
        Trained("ppo", IMITATION, 0, CLONED, cloning={"labels": 8000}),
    ),
    StudyRow(
        "clone_demonstrations",
        "as many labels, all of the law's own walks",
        ABLATIONS,
        Trained("ppo", IMITATION, 0, CLONED, cloning=DEMONSTRATIONS),
    ),
    StudyRow(
        "front",
        "imitation of a gain schedule",
        FRONT,
        Following(
            "ppo",
            IMITATION,
            0,
            CLONED,
            speeds=(0.51, 0.62),
            commands=(0.52, 0.54, 0.56, 0.58, 0.6, 0.62),
            changes=(0.56, 0.62, 0.52, 0.6, 0.54, 0.58),
            cloning={"gait_starts": 256, "gait_labels": 80_000, "gradient_steps": 4500},
        ),
    ),
    StudyRow(
        "disturbed",
        "fine-tuned under delay and noise",
        DISTURBED,
        Disturbed(
            "ppo",
            IMITATION,
            6_000_000,
            {"clone": CLONE, "best kept": BEST},
            disturbances={"actuator_delay": 2, "sensor_noise": TWICE_THE_NOISE},
            task={"distance_weight": 0.1, "target_speed": 0.6},
            hyperparameters=LARGE_BATCHES,
        ),
        enough=0.9,
    ),
    StudyRow("first_evening", "PPO of stable-baselines3", FIRST_EVENING, PlainPpo(), enough=0.8),
)
