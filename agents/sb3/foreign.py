"""Policies in files of plain stable-baselines3, which are pickles."""

from __future__ import annotations

from pathlib import Path

from agents import learners
from agents.conditions import Conditions
from agents.sb3.learner import Sb3Learner
from agents.sb3.networks import NetworkPolicy
from agents.sb3.training_env import training_env
from rimless_gym.envs.task import Task
from rimless_gym.params import WheelParams


def unpickled(path: Path, params: WheelParams) -> tuple[str, NetworkPolicy]:
    """The name of the learner and the policy in a file; reading it runs whatever code is in it.

    Raises:
        ValueError: it is of none of our learners.
    """
    env = training_env(1, Conditions(params), Task(), seed=0)
    causes = []
    for name in learners.names():
        kind = learners.learner(name)
        if not issubclass(kind, Sb3Learner):
            continue
        try:
            return name, NetworkPolicy(kind.algorithm.load(path, env=env, device="cpu"))
        except Exception as error:  # unpickling can raise anything
            causes.append(f"{name}: {error!r}")
    raise ValueError(f"{path}: not a model of a known algorithm ({'; '.join(causes)})")
