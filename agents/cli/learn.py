"""`rimless train`, `rimless tune` and `rimless compare`."""

from __future__ import annotations

import sys
from pathlib import Path

from agents.cli.options import (
    Count,
    Fields,
    Flag,
    MaybeCount,
    MaybePositive,
    MaybeRange,
    MaybeWhole,
    Positive,
    Positives,
    Preset,
    Range,
    Whole,
    machine,
    require_folder,
)


def train(
    *,
    algo: str = "ppo",
    init: str = "scratch",
    expert: str = "lqr",
    seed: Whole = 0,
    out: Path = Path("runs/train"),
    timesteps: MaybeWhole = None,
    preset: Preset = "BUILDABLE",
    params: Fields = None,
    task: Fields = None,
    ranges: Fields = None,
    disturbances: Fields = None,
    speeds: MaybeRange = None,
    control_period: MaybePositive = None,
    settings: Fields = None,
    cloning: Fields = None,
    prior: str | None = None,
    startup: Flag = False,
) -> int:
    """Train a policy: from scratch, from a clone of a feedback law, or from a policy.

    Writes best.zip (best in the periodic evaluations), last.zip, clone.zip (with --init imitation),
    train.json, state.pt (all that is needed to continue) and TensorBoard events into a folder.
    However it was stopped, the same command continues, and ends with the same policies.

    Args:
        algo: learner: ppo, sac, evolution; cma_es and gradients fine-tune
        init: scratch, imitation, or a policy's file to start from
        expert: what to imitate: a feedback law (see `rimless list`), or a policy's file to distil
        seed: of everything random
        out: folder of the results
        timesteps: time steps in all; by default the learner's own
        preset: machine
        params: fields that differ from the preset's: hub_damping=0.01 n_legs=6
        task: weights of the reward: distance_weight=0.8
        ranges: parameters to draw for every episode: pendulum_mass=[2.0,2.4]
        disturbances: pushes.rate=0.5 pushes.impulse=[0.1,0.5] actuator_delay=1
            sensor_noise.leg_rate=0.1
        speeds: command a speed between these (m/s), as in RimlessWheelSpeed-v0
        control_period: how long an action is held (s); by default as in the environment
        settings: hyperparameters that differ from the learner's own: gamma=0.995
        cloning: how to imitate, fields of agents.imitation.Cloning: gait_labels=80000
        prior: law: a feedback law's values shape the reward, and some walks begin on its way
        startup: imitate a policy near its own gait only, and far from it the start-up controller
            of that gait, which is computed first
    """
    from agents.learner import learner_class

    learner = learner_class(algo)  # prints a line first: this and the next imports load PyTorch
    from agents.training import train as trained
    from agents.training_config import TrainingConfig

    config = TrainingConfig(
        algo,
        init,
        seed,
        timesteps,
        machine(preset, params),
        task,
        ranges,
        disturbances,
        speeds,
        control_period,
        hyperparameters=settings or {},
        expert=expert,
        startup=startup,
        cloning=cloning,
        prior=prior,
    )
    config.training()  # what is refused here makes no folder
    require_folder(out)
    trained(config, out)
    policy = out / learner.recommended
    print(f"recommended policy: {policy}; measure it with `rimless evaluate {policy}`")
    return 0


def tune(
    *,
    algo: str = "ppo",
    trials: Count = 50,
    init: str = "scratch",
    prior: str | None = None,
    seed: Whole = 0,
    timesteps: MaybeWhole = None,
    preset: Preset = "BUILDABLE",
    params: Fields = None,
    task: Fields = None,
    settings: Fields = None,
    out: Path = Path("runs/tune"),
    workers: MaybeCount = None,
) -> int:
    """Search for the hyperparameters of a learner with Optuna.

    Writes best.yml, which rl-zoo3 reads as --conf-file, optuna.journal, an Optuna study, and the
    training of every trial into a folder. However it was stopped, the same command continues; so it
    does with more trials.

    Args:
        algo: ppo or sac
        trials: trainings in all
        init: as of `rimless train`
        prior: as of `rimless train`
        seed: of everything random
        timesteps: time steps of a trial; by default the learner's own
        preset: machine
        params: fields that differ from the preset's: hub_damping=0.01 n_legs=6
        task: weights of the reward: distance_weight=0.8
        settings: hyperparameters that are not searched for: gamma=0.995
        out: folder of the search
        workers: processes; by default as many as cores
    """
    from agents.training_config import TrainingConfig
    from agents.tuning import BEST
    from agents.tuning import tune as tuned

    config = TrainingConfig(
        algo,
        init,
        seed,
        timesteps,
        machine(preset, params),
        task,
        hyperparameters=settings or {},
        prior=prior,
    )
    config.training()  # what is refused here makes no folder
    require_folder(out)
    score = tuned(config, trials, out, workers)
    print(f"best score {score:.4g}: {out / BEST}")
    return 0


def compare(
    *,
    out: Path = Path("runs/compare"),
    preset: Preset = "BUILDABLE",
    params: Fields = None,
    speed: Positive = 0.62,
    further: Positives = (0.56, 0.6),
    steps: Count = 1,
    seed: Whole = 0,
    timesteps: Whole = 100_000_000,
    scratch_timesteps: Whole = 250_000,
    evolution_timesteps: Whole = 600_000_000,
    starts: Whole = 4,
    front: Range = (0.55, 0.64),
    retrain: Flag = False,
    workers: MaybeWhole = None,
) -> int:
    """Compare learned with optimal cost of transport, at several speeds: the main job.

    Solves the front of optimal gaits, with a free voltage and as the environment allows, holds the
    latter with feedback, clones the feedback law, trains PPO from scratch, and measures them and
    the policies that come with the package in the same way; `evolution`, `fine_tuned` and
    `evolved` are trained where the machine, the speed, the seed or their control intervals are
    others. Writes results.json, table.md, plots, an animation, and report.html. However it was
    stopped, the same command continues, and ends with the same table.

    Args:
        out: folder of the results
        preset: machine; BUILDABLE and THESIS_PHYSICAL have shipped gaits
        params: fields that differ from the preset's: hub_damping=0.01 n_legs=6
        speed: of all laws and the clone (m/s)
        further: speeds at which the optimum and the policy for the front are shown too (m/s)
        steps: of the gait, per stride
        seed: of everything random
        timesteps: control intervals of fine-tuning
        scratch_timesteps: control intervals of PPO from scratch
        evolution_timesteps: control intervals of evolution
        starts: random starts of the search for the gait
        front: speeds of the optimal front (m/s)
        retrain: train also `evolution`, `fine_tuned` and `evolved`, which come with the package
        workers: processes; by default as many as cores
    """
    from agents.comparison.compare import compare as compared
    from agents.comparison.study import Study
    from agents.comparison.table import format_table
    from trajopt.pool import cores

    machine(preset, params)
    study = Study(
        preset=preset,
        changes=params or {},
        speed=speed,
        further=further,
        steps=steps,
        seed=seed,
        timesteps=timesteps,
        scratch_timesteps=scratch_timesteps,
        evolution_timesteps=evolution_timesteps,
        starts=starts,
        front=front,
        retrain=retrain,
    )
    require_folder(out)
    try:
        rows = compared(study, out, workers=workers or cores())
    except KeyboardInterrupt:
        raise KeyboardInterrupt(f"finished work is in {out}; the same command continues") from None
    print(format_table(rows))
    print(f"results, plots and an animation: {out}; open {out / 'report.html'}", file=sys.stderr)
    return 0
