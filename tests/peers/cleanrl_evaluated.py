"""Trains with a script of CleanRL and evaluates the policy: cleanrl_evaluated.py NAME ARGUMENTS.

It is evaluated at each commanded speed as those of docs/learning.md are.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import torch
from cleanrl_shims import run
from gymnasium.wrappers import NormalizeObservation

from agents.evaluate import COMMANDS, evaluate_commanded
from agents.rollout import Act, learned_policy


def normalisation(env: Any) -> NormalizeObservation:
    """The wrapper of an environment that has the mean and variance of what was observed."""
    while not isinstance(env, NormalizeObservation):
        env = env.env
    return env


def sac(trained: dict[str, Any]) -> Act:
    """The mean action of its SAC."""
    actor = trained["actor"]
    return lambda observations: actor.get_action(observations)[2]


def ppo(trained: dict[str, Any]) -> Act:
    """The mean action of its PPO, clipped; it sees normalised observations."""
    agent, envs = trained["agent"], trained["envs"]
    wrapper = normalisation(envs.envs[0])
    mean, variance = wrapper.obs_rms.mean, wrapper.obs_rms.var + wrapper.epsilon
    low, high = envs.single_action_space.low[0], envs.single_action_space.high[0]

    def act(observations: torch.Tensor) -> torch.Tensor:
        seen = np.clip((observations.numpy() - mean) / np.sqrt(variance), -10, 10)
        return agent.actor_mean(torch.as_tensor(seen, dtype=torch.float32)).clip(low, high)

    return act


ACTS = {"ppo_continuous_action": ppo, "sac_continuous_action": sac}

if __name__ == "__main__":
    name, *arguments = sys.argv[1:]
    act = ACTS[name](run(name, arguments))

    @torch.no_grad()
    def voltages(observations: Any) -> Any:
        return act(torch.as_tensor(observations, dtype=torch.float32))[:, 0].double().numpy()

    evaluations = evaluate_commanded(learned_policy(voltages))
    for command, walks in zip(COMMANDS, evaluations, strict=True):
        print(
            f"commanded {command:g} m/s: {100 * walks.walking_share:.0f} % walk, "
            f"CoT {walks.cot:.4f} at {walks.speed:.3f} m/s"
        )
