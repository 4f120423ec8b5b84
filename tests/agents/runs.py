"""Short trainings for the tests beside this file."""

import dataclasses

import numpy as np
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from agents import learners
from agents.evaluate import Protocol
from agents.imitation import Cloning
from agents.policy_files import load_policy
from agents.train import train

BRIEF = Protocol(starts=4, seed=1, duration=0.5, window=0.25, alive=0.25)
#: So long that nothing walks on its first momentum any more.
SETTLED = Protocol(starts=4, seed=1, duration=4.0, window=1.0, alive=1.0)
QUICK = Cloning(
    rounds=1,
    expert_starts=10,
    seconds=0.5,
    gradient_steps=20,
    batch_size=64,
    labels=500,
    gait_labels=50,
)
STEPS = {"ppo": 512, "sac": 160, "evolution": 1_000_000}
SHORT_SEARCH = {
    "screened": 400,
    "kept": 20,
    "screen_intervals": 400,
    "contenders": 2,
    "trial": 10,
    "finalists": 1,
    "race": 10,
    "population": 8,
    "intervals": 400,
    "starts": 4,
    "refining_intervals": 400,
    "refining_starts": 4,
    "setting_off_intervals": 200,
    "setting_off_starts": 8,
    "refining_looked_at": 32,
}


def small(algo, init="scratch"):
    """Two environments and short roll-outs, or a short search; all else as published."""
    settings = learners.learner(algo).settings(str(init))
    if algo == "evolution":
        return dataclasses.replace(settings, **SHORT_SEARCH)
    changes = {"n_steps": 64, "batch_size": 64}
    if algo == "sac":
        changes = {"learning_starts": 50, "buffer_size": 2000}
    return dataclasses.replace(
        settings,
        n_envs=2,
        n_timesteps=512,
        silent=changes.get("learning_starts", 0),
        algorithm=settings.algorithm | changes,
    )


def run(out, algo="ppo", **changes):
    arguments = {"timesteps": STEPS[algo], "protocol": BRIEF, "progress": False} | changes
    arguments.setdefault("settings", small(algo, arguments.get("init", "scratch")))
    return train(algo, out=out, **arguments)


def weights(path):
    policy = load_policy(path).model.policy
    return torch.cat([p.detach().ravel() for p in policy.parameters()]).numpy()


def assert_same_policies(one, other):
    """Check that two results of `train` have the same best and last policies."""
    for policy in ("best", "last"):
        np.testing.assert_array_equal(*(weights(getattr(each, policy)) for each in (one, other)))


def scalars(folder):
    events = EventAccumulator(str(folder)).Reload()
    return {tag: events.Scalars(tag) for tag in events.Tags()["scalars"]}
