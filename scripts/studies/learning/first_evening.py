"""stable-baselines3 as it is, with every default, on `RimlessWheelSpeed-v0`: a first evening."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Any

from agents import Sb3VecEnv, protocol
from agents.commanded import COMMANDS, evaluate_commanded
from agents.policies import Act, learned_policy
from agents.stopwatch import forget, timed
from rimless_gym.checks import extra
from rimless_gym.envs.speed import PERIOD
from rimless_gym.params import WheelParams
from scripts.studies.learning.figures import Figures
from trajopt.feedback.law import Floats

with extra("learn"):
    import torch
    from stable_baselines3 import PPO, SAC
    from stable_baselines3.common.base_class import BaseAlgorithm
    from stable_baselines3.common.env_util import make_vec_env

TASK = "RimlessWheelSpeed-v0"

#: Weights and the number of steps, in the folder of a seed. No pickled code is in it.
POLICY = "policy.pt"

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"PPO": PPO, "SAC": SAC}

#: Steps of a trial that only shows that it runs.
BRIEF_STEPS = 2048


@dataclasses.dataclass(frozen=True)
class FirstEvening:
    """An algorithm of stable-baselines3 with a network, and every setting at its default.

    A training that was stopped begins again: stable-baselines3 keeps no state to go on from.

    Attributes:
        algorithm: its name, "PPO" or "SAC".
        n_envs: environments side by side.
        timesteps: of all of them together.
        commands: the speeds at which the policy is judged (m/s).
    """

    algorithm: str = "PPO"
    n_envs: int = 8
    timesteps: int = 500_000
    commands: tuple[float, ...] = COMMANDS

    @property
    def settings(self) -> dict[str, Any]:
        """The fields."""
        return dataclasses.asdict(self) | {"commands": list(self.commands)}

    @property
    def period(self) -> float:
        """How long its policies hold an action (s)."""
        return PERIOD

    def train(self, seed: int, folder: Path, params: WheelParams) -> int:
        """Train from the beginning, unless it was finished before."""
        path = folder / POLICY
        if not path.exists():
            forget(folder)
            with timed(folder):
                model = self._model(params, seed).learn(self.timesteps)
            kept = {"steps": model.num_timesteps, "weights": model.policy.state_dict()}
            torch.save(kept, part := path.with_suffix(".part"))
            os.replace(part, path)
        return int(_read(path)["steps"])

    def judge(self, folder: Path, params: WheelParams, by: protocol.Protocol) -> dict[str, Figures]:
        """The policy at every commanded speed."""
        model = self._model(params, 0)
        model.policy.load_state_dict(_read(folder / POLICY)["weights"])
        judged = evaluate_commanded(learned_policy(_act(model)), self.commands, params, by)
        return {f"{each.command:g} m/s": Figures.of(each.evaluation) for each in judged}

    def brief(self) -> FirstEvening:
        """The same with few steps."""
        return dataclasses.replace(self, timesteps=BRIEF_STEPS)

    def _model(self, params: WheelParams, seed: int) -> BaseAlgorithm:
        envs = make_vec_env(
            TASK,
            self.n_envs,
            seed,
            vec_env_cls=Sb3VecEnv,  # type: ignore[arg-type]
            env_kwargs={"params": params},
        )
        return ALGORITHMS[self.algorithm]("MlpPolicy", envs, seed=seed, device="cpu")  # type: ignore[call-arg]


def _act(model: BaseAlgorithm) -> Act:
    def act(observations: Any) -> Floats:
        actions, _ = model.predict(observations, deterministic=True)
        return actions[:, 0].astype(float)

    return act


def _read(path: Path) -> dict[str, Any]:
    """What a training left.

    Raises:
        ValueError: the file is damaged.
    """
    try:
        return dict(torch.load(path, weights_only=True))
    except Exception as error:  # a damaged archive raises almost anything
        raise ValueError(f"{path}: damaged ({error!r}); remove it to train anew") from error
