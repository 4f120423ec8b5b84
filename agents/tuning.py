"""A search for hyperparameters with Optuna, whose trials are trainings side by side."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any, cast

from agents.reward_weight import economy
from agents.training import DivergedError, train
from agents.training_config import TrainingConfig
from rimless_gym.checks import extra, integer
from trajopt import pool
from trajopt.store import Store, key, write_text

with extra("tune"):
    import optuna
    import yaml
    from optuna import Study
    from optuna.distributions import BaseDistribution
    from optuna.distributions import CategoricalDistribution as Choice
    from optuna.distributions import FloatDistribution as Float
    from optuna.distributions import IntDistribution as Int
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend
    from optuna.trial import TrialState

#: Files of a search: Optuna's record of it, and the best trial so far, as rl-zoo3 reads it.
JOURNAL, BEST = "optuna.journal", "best.yml"

#: Folder of what all trials use: the gaits and plans of a law.
CACHE = "plans"


def tune(config: TrainingConfig, trials: int, out: Path, workers: int | None = None) -> float:
    """Search for the hyperparameters of PPO or SAC with which a training ends best.

    Optuna's TPE proposes values of those in `space` that `config` does not give. The score is
    `agents.reward_weight.economy` of the best periodic evaluation: a power of the share of starts
    that walk, over their cost of transport. What is proposed depends on which trials have ended, so
    only searches by one worker without a stop are reproducible.

    However it was stopped, the same call continues, and so do trainings that save their state. More
    trials continue a finished search.

    Args:
        config: of every training.
        trials: in all.
        out: folder of the search; workers of a cluster must share it.
        workers: see `trajopt.pool.run`.

    Returns:
        The best score.

    Raises:
        ValueError: an argument is out of range, `out` holds another search, or no training ended.
    """
    trials, inputs = integer("trials", trials, 1), config.training().identity
    given = dict(cast(Mapping[str, Any], config.hyperparameters))
    # with a prior, noise is given, and no bonus for entropy
    left_out = {*given, *(() if config.prior is None else ("ent_coef",))}
    searched = {name: of for name, of in space(config.algo).items() if name not in left_out}
    with Store(out, {**inputs, "timesteps": config.timesteps}) as store:
        study = _study(out, config.seed)
        work, tasks = functools.partial(_score, config, store), _tasks(study, searched, trials)
        try:
            with closing(pool.run(work, tasks, workers, progress=f"tune {config.algo}")) as results:
                for (number, _), score in results:
                    diverged = TrialState.PRUNED if score is None else None
                    study.tell(number, score, state=diverged)
        finally:
            ended = study.get_trials(states=[TrialState.COMPLETE])
            if ended:
                entry = dict(_with(config, study.best_params).training().settings.written)
                if config.timesteps is not None:
                    entry["n_timesteps"] = config.timesteps
                text = yaml.safe_dump({"RimlessWheel-v0": entry}, sort_keys=False)
                about = f"{config.algo}: score {study.best_value:.4g}, best of {len(ended)} trials"
                write_text(out / BEST, f"# {about}\n{text}")
    if not ended:
        raise ValueError(f"{out}: every training diverged; give other hyperparameters")
    return study.best_value


def _study(out: Path, seed: int) -> Study:
    """The study in a folder; trials that a stop left unfinished are the next ones."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(
        storage=JournalStorage(JournalFileBackend(str(out / JOURNAL))),
        study_name="rimless-gym",
        direction="maximize",
        load_if_exists=True,
    )
    # another seed than before a stop, or it would begin with the same proposals
    seed += len(study.trials)
    study.sampler = optuna.samplers.TPESampler(seed=seed, constant_liar=True)
    for trial in study.get_trials(states=[TrialState.RUNNING]):
        study.tell(trial.number, state=TrialState.FAIL)
        study.enqueue_trial(trial.params)
    return study


def _tasks(
    study: Study, searched: dict[str, BaseDistribution], trials: int
) -> Iterator[tuple[int, dict[str, Any]]]:
    """Numbers and hyperparameters of trials, each when a worker is about to be free."""
    ended = study.get_trials(states=[TrialState.COMPLETE, TrialState.PRUNED])
    for _ in range(trials - len(ended)):
        trial = study.ask(searched)
        yield trial.number, trial.params


def _score(config: TrainingConfig, store: Store, task: tuple[int, dict[str, Any]]) -> float | None:
    """Train with these hyperparameters: the best score, or None if the training diverged."""
    config = _with(config, task[1])
    folder = store.folder / key("trial", **task[1])
    try:
        trained = train(config, folder, cache=store.folder / CACHE, progress=False)
    except DivergedError:
        return None
    return max(economy(each.walking_share, each.cot) for each in trained.curve)


def _with(config: TrainingConfig, values: Mapping[str, Any]) -> TrainingConfig:
    """A training with these hyperparameters, besides those that are given."""
    given = cast(Mapping[str, Any], config.hyperparameters)
    return dataclasses.replace(config, hyperparameters={**values, **given})


def space(algo: str) -> dict[str, BaseDistribution]:
    """What is searched, by hyperparameter; ranges are around those in `agents/hyperparams`."""
    spaces: dict[str, dict[str, BaseDistribution]] = {
        "ppo": {
            "learning_rate": Float(1e-5, 1e-2, log=True),
            "n_steps": Choice((32, 64, 128, 256, 512)),
            "batch_size": Choice((512, 1024, 2048, 4096, 8192)),
            "n_epochs": Int(1, 20),
            "gamma": Choice((0.95, 0.98, 0.99, 0.995, 0.998, 0.999)),
            "gae_lambda": Choice((0.9, 0.95, 0.97, 0.99, 1.0)),
            "clip_range": Choice((0.1, 0.2, 0.3)),
            "ent_coef": Float(1e-6, 1e-2, log=True),
        },
        "sac": {
            "learning_rate": Float(1e-5, 1e-2, log=True),
            "batch_size": Choice((128, 256, 512, 1024)),
            "gradient_steps": Int(1, 8),
            "gamma": Choice((0.98, 0.99, 0.995, 0.998)),
            "tau": Float(1e-3, 5e-2, log=True),
            "ent_coef": Float(1e-6, 1e-1, log=True),
        },
    }
    if algo not in spaces:
        raise ValueError(f"algo = {algo!r}: only those of {', '.join(spaces)} are searched for")
    return spaces[algo]
