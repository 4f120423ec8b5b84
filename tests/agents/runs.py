"""Short trainings for the tests beside this file."""

import numpy as np
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from agents.evaluate import Protocol
from agents.policy_files import load_policy
from agents.training import Trainer, train
from agents.training_config import TrainingConfig

BRIEF = Protocol(starts=4, seed=1, duration=0.5, window=0.25, alive=0.25)
#: So long that nothing walks on its first momentum any more.
SETTLED = Protocol(starts=4, seed=1, duration=4.0, window=1.0, alive=1.0)
#: A cloning that takes a moment.
QUICK = {
    "rounds": 1,
    "expert_starts": 10,
    "seconds": 0.5,
    "gradient_steps": 20,
    "batch_size": 64,
}
STEPS = {"ppo": 512, "sac": 160, "evolution": 1_000_000}
#: Two environments and short roll-outs, or a short search; all else as published.
SMALL = {
    "ppo": {"n_envs": 2, "n_steps": 64, "batch_size": 64},
    "sac": {"n_envs": 2, "learning_starts": 50, "buffer_size": 2000},
    "evolution": {
        "screened": 400,
        "retained": 20,
        "screen_intervals": 400,
        "candidates": 2,
        "trial": 10,
        "finalists": 1,
        "race": 10,
        "population": 8,
        "intervals": 400,
        "starts": 4,
        "refining_intervals": 400,
        "refining_starts": 4,
        "start_up_intervals": 200,
        "start_up_starts": 8,
        "refining_checked_starts": 32,
    },
}


def config(algo="ppo", hyperparameters=None, **changes):
    settings = {"timesteps": STEPS.get(algo), "protocol": BRIEF} | changes
    return TrainingConfig(
        algo, hyperparameters=SMALL.get(algo, {}) | (hyperparameters or {}), **settings
    )


def run(out, algo="ppo", **changes):
    return train(config(algo, **changes), out, progress=False)


def weights(path):
    """All weights of a policy's file."""
    parts = load_policy(path).parts.weights
    return np.concatenate([parts[name].ravel() for name in sorted(parts)])


def assert_same_policies(one, other):
    """Check that two results of `train` have the same best and last policies."""
    for policy in ("best", "last"):
        np.testing.assert_array_equal(*(weights(getattr(each, policy)) for each in (one, other)))


def killed_after(calls, monkeypatch, begin):
    """Train until the learner has taken so many steps; then the process is killed."""
    on_step, seen = Trainer.on_step, []

    def killed(self):
        seen.append(1)
        if len(seen) == calls:
            raise SystemExit
        on_step(self)

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "on_step", killed)
        try:
            begin()
        except SystemExit:
            return
    raise AssertionError("it ended before it was killed")


def scalars(folder):
    events = EventAccumulator(str(folder)).Reload()
    return {tag: events.Scalars(tag) for tag in events.Tags()["scalars"]}
