"""The rows of the study. One more learner is one more entry in `ROWS`."""

from __future__ import annotations

from agents.evaluate import COMMANDS
from agents.learner import BEST, CLONE, IMITATION, LAST, SCRATCH
from agents.prior import LAW
from rimless_gym.envs.speed import PERIOD
from scripts.studies.feedback_laws.measures import NOISE
from scripts.studies.learning.trials import Disturbed, Following, Other, StudyRow, Trained

#: The tables of the page: policies for `RimlessWheel-v0`; ablations of cloning; those that follow
#: commands as efficiently as the front allows; those that learned under disturbances; and those of
#: plain stable-baselines3 for commanded speeds.
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

#: Standard deviations of the sensors' errors (rad, rad/s): `noise x 2` of docs/feedback.md.
TWICE_THE_NOISE = {name: 2 * deviation for name, deviation in NOISE.items()}


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
WITH_PRIOR = StudyRow(
    "ppo_prior",
    "PPO with the law as prior",
    LEARNED,
    Trained("ppo", files={"": LAST}, prior=LAW),
)

ROWS = (
    IMITATED,
    StudyRow(
        "fine_tuned",
        "imitation, fine-tuned by CMA-ES",
        LEARNED,
        Trained("cma_es", IMITATION, None, BEST_ONLY, start=Other(IMITATED, CLONE)),
    ),
    StudyRow(
        "gradients",
        "imitation, fine-tuned by gradients",
        LEARNED,
        Trained("gradients", IMITATION, None, {"": LAST}, start=Other(IMITATED, CLONE)),
    ),
    StudyRow("ppo", "PPO from scratch", LEARNED, Trained("ppo", files=KEPT)),
    WITH_PRIOR,
    StudyRow(
        "ppo_prior_cma_es",
        "PPO with the law as prior, then CMA-ES",
        LEARNED,
        Trained("cma_es", IMITATION, None, BEST_ONLY, start=Other(WITH_PRIOR, LAST)),
    ),
    EVOLVED,
    DISTILLED,
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
            speeds=(0.56, 0.63),
            commands=(0.56, 0.58, 0.6, 0.62),
            changes=(0.58, 0.62, 0.56, 0.6),
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
    StudyRow(
        "first_evening",
        "PPO of stable-baselines3",
        FIRST_EVENING,
        Following("ppo", SCRATCH, 500_000, {"": LAST}, commands=COMMANDS, period=PERIOD),
        enough=0.8,
    ),
)
