"""A clone of many machines' laws that has a memory: it also sees the last 0.4 s of its walk.

From one state nothing can tell which machine walks; from what the voltages did to it a network can
guess. It is taught as the clone without memory is, by `agents.imitation`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from agents.imitation import LabelledWalks, Teaching, clone
from agents.rollout import Policy, Running, learned_policy
from agents.sb3.feedforward import RATES, back_emf_gains
from rimless_gym import BUILDABLE
from rimless_gym.envs.layout import OBSERVATION_SIZE
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats

#: Lags, in control intervals, at which the network also sees the observation and the action.
LAGS = tuple(range(4, 41, 4))

#: Observation and action.
FRAME = OBSERVATION_SIZE + 1

WIDTH = 128


class Network(nn.Module):
    """Observations with their history (N, 76) -> voltages in units of the limit, (N,).

    It sees the observation, then observation and action at each of the 10 lags. The layers give the
    deviation from the nominal machine's back-EMF.
    """

    def __init__(self, seed: int = 0) -> None:
        super().__init__()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self.layers = nn.Sequential(
                *(nn.Linear(OBSERVATION_SIZE + len(LAGS) * FRAME, WIDTH), nn.Tanh()),
                *(nn.Linear(WIDTH, WIDTH), nn.Tanh()),
                nn.Linear(WIDTH, 1),
            )
        self.gains = torch.tensor(back_emf_gains(BUILDABLE), dtype=torch.float32)
        self.weights = list(self.parameters())

    def mean_action(self, seen: torch.Tensor) -> torch.Tensor:
        """The actions (N,), not clipped."""
        deviation: torch.Tensor = self.layers(seen)[:, 0]
        return deviation + seen[:, RATES] @ self.gains

    def act(self, seen: NDArray[np.float32]) -> Floats:
        """The actions (N,) in [-1, 1]."""
        with torch.no_grad():
            actions = self.mean_action(torch.from_numpy(seen)).numpy()
        return np.clip(actions.astype(np.float64), -1.0, 1.0)

    def set_noise(self, log_std: float) -> None:
        """It has none."""


class Remembering:
    """A policy that sees the history of each walk; by itself, it takes every call for a first."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy

    def begin(self, machines: Sequence[WheelParams], running: Running) -> Policy:
        """See `agents.rollout.begun`."""
        memory = np.zeros((len(machines), LAGS[-1] + 1, FRAME), dtype=np.float32)

        def remembering(states: Floats, observations: NDArray[np.float32]) -> Floats:
            rows = running()
            memory[rows] = np.roll(memory[rows], 1, axis=1)
            memory[rows, 0, :-1] = observations
            past = memory[rows][:, LAGS].reshape(len(rows), -1)
            actions = self.policy(states, np.concatenate([observations, past], axis=1))
            memory[rows, 0, -1] = actions
            return actions

        return remembering

    def __call__(self, states: Floats, observations: NDArray[np.float32]) -> Floats:
        """The actions (N,) in [-1, 1] of walks that begin now."""
        n = len(states)
        return self.begin((BUILDABLE,) * n, lambda: np.arange(n))(states, observations)


class TeachingWithHistory(Teaching):
    """Walks whose observations have their history, as `Remembering` sees it.

    The expert must act on states: it does not know what to do with such observations.
    """

    def walks(self, policy: Policy, starts: Floats, seed: tuple[int, ...]) -> LabelledWalks:
        """See `Teaching`."""
        if policy is self.expert:
            return with_history(super().walks(policy, starts, seed))
        return with_history(super().walks(Remembering(policy), starts, seed))


def with_history(walks: LabelledWalks) -> LabelledWalks:
    """Whole walks, with what was observed and done before: 0 before their beginning."""
    frames = np.zeros((len(walks.when) + 1, FRAME), dtype=np.float32)  # the last one: none
    frames[:-1, :-1], frames[:-1, -1] = walks.observations, walks.actions
    row = np.full((walks.which.max() + 1, walks.when.max() + 1 + LAGS[-1]), -1)
    row[walks.which, walks.when + LAGS[-1]] = np.arange(len(walks.when))
    past = [frames[row[walks.which, walks.when + LAGS[-1] - lag]] for lag in LAGS]
    return walks._replace(observations=np.concatenate([walks.observations, *past], axis=1))


def remembering(teaching: TeachingWithHistory, file: Path) -> Remembering:
    """The clone with a memory in a file; it is trained first if there is none."""
    torch.set_num_threads(1)  # sums depend on how they are split among threads
    network = Network(teaching.seed)
    if not file.exists():
        clone(network, teaching)
        unfinished = file.with_suffix(".part")
        torch.save(network.state_dict(), unfinished)
        unfinished.replace(file)
    network.load_state_dict(torch.load(file, weights_only=True))
    return Remembering(learned_policy(network.act))
