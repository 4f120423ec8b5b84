"""The rows of the study. One more learner is one more entry in `ROWS`."""

from __future__ import annotations

import math
from typing import Any

from agents import learners
from agents.folder import BEST, CLONE, LAST
from agents.training import IMITATION, SCRATCH
from rimless_gym.envs.task import USUAL_TASK
from rimless_gym.hybrid import CONTROL_PERIOD
from scripts.studies.feedback_laws.columns.changes import NOISE
from scripts.studies.learning.first_evening import FirstEvening
from scripts.studies.learning.row import Row
from scripts.studies.learning.successors import Continued, Distilled, WentOn
from scripts.studies.learning.trials import Disturbed, Following, Holding, Trained

#: The tables of the page: policies for `RimlessWheel-v0`, those for the thesis's machine, those of
#: plain stable-baselines3 for commanded speeds, those that follow commands as cheaply as the front
#: allows, and those that learned under disturbances.
LEARNED, THESIS, FIRST_EVENING = "learned", "thesis", "first_evening"
FRONT, DISTURBED = "front", "disturbed"

#: Tables of ablations: PPO at other prices, clones fine-tuned with other noise, other clones.
PRICE, EXPLORATION, CLONING = "price", "exploration", "cloning"

#: One more table, of the seeds one by one, for rows whose seeds differ much.
SEEDS = "seeds"

#: What distinguishes a policy -> its file: of a training, and of one that ends with the clone.
KEPT = (("best kept", BEST), ("last", LAST))
CLONED = (("", CLONE),)

#: Control intervals of a fine-tuning, as in the comparison.
FINE_TUNING = 600_000

#: Demonstrations alone: one round, with as many labels and gradient steps as DAgger's eight.
DEMONSTRATIONS = {"rounds": 1, "expert_starts": 1044, "gradient_steps": 6750}

#: Hyperparameters of a fine-tuning that changes more than the learner's own do.
LARGE_BATCHES = {"n_envs": 512, "n_steps": 128, "batch_size": 16384, "learning_rate": 5e-5}

#: The task's own price and charges, in place of those by which training usually pays.
OWN_PRICE = {
    "first_price": USUAL_TASK.distance_weight,
    "fall_penalty": USUAL_TASK.fall_penalty,
    "slip_penalty": USUAL_TASK.slip_penalty,
}

#: Standard deviations of the sensors' errors (rad, rad/s): `noise x 2` of docs/feedback.md.
TWICE_THE_NOISE = {name: 2 * deviation for name, deviation in NOISE.items()}


def _paced(**changes: float) -> dict[str, Any]:
    """Hyperparameters of PPO from scratch whose price is paced in another way (`Pacing`)."""
    (callback,) = learners.learner("ppo").settings(SCRATCH).written["callback"]
    return {"callback": [{name: usual | changes for name, usual in callback.items()}]}


def _noisy(deviation: float) -> Trained:
    """A fine-tuning with exploration noise of this share of the voltage limit.

    Travel is paid up to about the clone's own speed, so that it gains nothing by going faster. The
    learning rate is so low that the gait stays where there is hardly any noise.
    """
    return Trained(
        "ppo",
        IMITATION,
        1_500_000,
        (("before", CLONE), ("after", LAST)),
        cloning={"log_std": math.log(deviation)},
        task={"distance_weight": 0.1, "target_speed": 0.57},
        hyperparameters=LARGE_BATCHES | {"learning_rate": 1e-5},
    )


#: Rows whose policies others need.
IMITATED = Row(
    "imitation",
    "imitation of the LQR",
    LEARNED,
    Trained("ppo", IMITATION, 0, CLONED),
    minutes=1.5,
)
EVOLVED = Row(
    "evolution",
    "evolution from scratch",
    LEARNED,
    Trained("evolution", judged=KEPT),
    minutes=15.0,
)
DISTILLED = Row(
    "distilled",
    "evolution distilled into a network",
    LEARNED,
    Distilled("ppo", IMITATION, 0, CLONED, before=EVOLVED),
    minutes=2.0,
)
PRICE_STAYS = Row(
    "price_stays",
    "a price of 5 that never falls",
    PRICE,
    Trained("ppo", judged=KEPT, hyperparameters=_paced(least_price=5.0)),
    minutes=2.0,
)

ROWS = (
    IMITATED,
    Row(
        "fine_tuned",
        "imitation, fine-tuned by PPO",
        LEARNED,
        Continued("ppo", IMITATION, FINE_TUNING, KEPT, before=IMITATED),
        minutes=3.0,
    ),
    Row(
        "ppo",
        "PPO from scratch",
        LEARNED,
        Trained("ppo", judged=KEPT),
        minutes=4.0,
    ),
    Row(
        "screened_ppo",
        "PPO from screened policies",
        LEARNED,
        Trained("screened_ppo", judged=KEPT),
        minutes=10.0,
        one_by_one=True,
    ),
    EVOLVED,
    DISTILLED,
    Row(
        "distilled_tuned",
        "distilled evolution, fine-tuned by PPO",
        LEARNED,
        Continued("ppo", IMITATION, FINE_TUNING, KEPT, before=DISTILLED),
        minutes=3.0,
    ),
    Row(
        "price_true",
        "the task's own price, 0.5, and its charges",
        PRICE,
        Trained("ppo", judged=KEPT, hyperparameters=_paced(**OWN_PRICE)),
        minutes=2.0,
    ),
    PRICE_STAYS,
    Row(
        "price_any_speed",
        "a price of 5 that never falls, paid at any speed",
        PRICE,
        Trained("ppo", judged=KEPT, hyperparameters=_paced(least_price=5.0, paid_speed=100.0)),
        minutes=2.0,
    ),
    Row(
        "price_drops",
        "a price of 5 that never falls, then the task's own at once",
        PRICE,
        WentOn(
            "ppo",
            SCRATCH,
            None,
            KEPT,
            before=PRICE_STAYS,
            hyperparameters=_paced(**OWN_PRICE),
        ),
        minutes=2.0,
    ),
    Row("noise_small", "noise of 0.0025", EXPLORATION, _noisy(0.0025), minutes=3.0),
    Row("noise_usual", "noise of 0.011", EXPLORATION, _noisy(0.011), minutes=3.0),
    Row("noise_large", "noise of 0.03", EXPLORATION, _noisy(0.03), minutes=3.0),
    Row(
        "clone_few_labels",
        "8,000 labels of start-up states a round instead of 60,000",
        CLONING,
        Trained("ppo", IMITATION, 0, CLONED, cloning={"labels": 8000}),
        minutes=1.5,
    ),
    Row(
        "clone_demonstrations",
        "as many labels, all of the law's own walks",
        CLONING,
        Trained("ppo", IMITATION, 0, CLONED, cloning=DEMONSTRATIONS),
        minutes=1.5,
    ),
    Row(
        "thesis_imitation_slow",
        "imitation of the LQR about 0.5 m/s",
        THESIS,
        Holding("ppo", IMITATION, 0, CLONED, speed=0.5),
        minutes=2.0,
        machine="THESIS_PHYSICAL",
    ),
    Row(
        "thesis_imitation",
        "imitation of the LQR about 0.57 m/s",
        THESIS,
        Holding("ppo", IMITATION, 0, CLONED, speed=0.57),
        minutes=2.0,
        machine="THESIS_PHYSICAL",
    ),
    Row(
        "thesis_evolution",
        "evolution from scratch, distance paid up to 0.55 m/s",
        THESIS,
        Trained("evolution", judged=KEPT, hyperparameters={"paid_speed": 0.55}),
        minutes=6.0,
        machine="THESIS_PHYSICAL",
    ),
    Row(
        "front",
        "imitation of a ladder of laws",
        FRONT,
        Following(
            "ppo",
            IMITATION,
            0,
            CLONED,
            speeds=(0.51, 0.62),
            control_period=CONTROL_PERIOD,
            commands=(0.52, 0.54, 0.56, 0.58, 0.6, 0.62),
            changes=(0.56, 0.62, 0.52, 0.6, 0.54, 0.58),
            cloning={"gait_starts": 256, "gait_labels": 80_000, "gradient_steps": 4500},
        ),
        minutes=6.0,
    ),
    Row(
        "disturbed",
        "fine-tuned under delay and noise",
        DISTURBED,
        Disturbed(
            "ppo",
            IMITATION,
            6_000_000,
            (("clone", CLONE), ("best kept", BEST), ("last", LAST)),
            disturbances={"actuator_delay": 2, "sensor_noise": TWICE_THE_NOISE},
            task={"distance_weight": 0.1, "target_speed": 0.6},
            hyperparameters=LARGE_BATCHES,
        ),
        enough=0.9,
        minutes=6.0,
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
