"""Policies in files of plain stable-baselines3, which are pickles."""

from __future__ import annotations

from pathlib import Path

from stable_baselines3.common.utils import check_for_correct_spaces

from agents import learners
from agents.conditions import Conditions
from agents.policies import Seeing
from agents.sb3.learner import Sb3Learner
from agents.sb3.networks import NetworkPolicy
from agents.sb3.training_env import training_env
from rimless_gym.envs.arguments import USUAL, Control
from rimless_gym.envs.layout import COMMANDED_SIZE
from rimless_gym.envs.speed import PERIOD, SPEEDS
from rimless_gym.params import WheelParams


def unpickled(path: Path, params: WheelParams) -> tuple[str, Seeing, Conditions]:
    """The learner's name, the policy and its conditions; reading a file runs whatever code it has.

    Raises:
        ValueError: it is of none of our learners, or of another environment.
    """
    causes = []
    for name in learners.names():
        kind = learners.learner(name)
        if not issubclass(kind, Sb3Learner):
            continue
        try:
            model = kind.algorithm.load(path, device="cpu")
            (size,) = model.observation_space.shape
            control = Control(PERIOD, speeds=SPEEDS) if size == COMMANDED_SIZE else USUAL
            conditions = Conditions(params, control=control)
            env = training_env(1, conditions, conditions.default_task, seed=0)
            check_for_correct_spaces(env, model.observation_space, model.action_space)
            return name, Seeing(NetworkPolicy(model), size), conditions
        except Exception as error:  # unpickling can raise anything
            causes.append(f"{name}: {error!r}")
    raise ValueError(f"{path}: not a model of a known algorithm ({'; '.join(causes)})")
