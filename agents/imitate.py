"""Behaviour cloning of a controller into a stable-baselines3 policy, with DAgger.

The first round learns from the expert's own walks; in the later ones the clone walks and the
expert says what it would have done (Ross, Gordon and Bagnell, AISTATS 2011), so that the clone
learns to get out of its own mistakes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from tqdm import tqdm

from agents.policies import Controller, Floats, Policy, controller_policy, model_policy
from agents.rollout import Interval, draw_starts, rollout
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams

Observations = NDArray[np.float32]


@dataclasses.dataclass(frozen=True)
class Cloning:
    """How to clone.

    Attributes:
        rounds: of DAgger, the expert's own included.
        starts: random starts that the clone walks from in each round.
        expert_starts: random starts that the expert walks from in the first.
        seconds: length of each walk (s).
        labels: states of the first halves of a clone's walks that the expert labels, per round;
            far from its gait it looks ahead, which takes a millisecond.
        late_labels: the same of the second halves, where a clone that walks is near the gait.
        gradient_steps: in each round; twice as many in the last.
        batch_size: observations per gradient step.
        huber: error (in units of the voltage limit) above which the loss grows only linearly:
            where the expert switches, no smooth network follows, and near the gait all counts.
        learning_rate: at the beginning; it falls to 0 along a cosine over all rounds.
        log_std: natural logarithm of the cloned policy's exploration noise.
        held_out: share of the walks kept for measuring the error.
    """

    rounds: int = 4
    starts: int = 256
    expert_starts: int = 64
    seconds: float = 6.0
    labels: int = 10_000
    late_labels: int = 30_000
    gradient_steps: int = 1500
    batch_size: int = 1024
    learning_rate: float = 2e-3
    huber: float = 0.05
    log_std: float = -4.0
    held_out: float = 0.1

    def __post_init__(self) -> None:
        for name in ("rounds", "starts", "expert_starts", "seconds", "labels", "batch_size"):
            if getattr(self, name) <= 0:
                raise ValueError(f"{name} = {getattr(self, name)}: must be greater than 0")
        if not 0 < self.held_out < 1:
            raise ValueError(f"held_out = {self.held_out}: must lie strictly between 0 and 1")


@dataclasses.dataclass(frozen=True)
class CloneReport:
    """What cloning came to.

    Attributes:
        samples: labelled observations, all rounds together.
        errors: after each round, the root-mean-square error on walks held out so far, in units
            of the voltage limit.
    """

    samples: int
    errors: tuple[float, ...]


def clone(
    model: Any,
    expert: Controller,
    params: WheelParams,
    config: Cloning | None = None,
    *,
    seed: int = 0,
    progress: bool = False,
) -> CloneReport:
    """Train the actor of a stable-baselines3 PPO or SAC `model` to act as `expert` does.

    The model is changed in place; its critic is left alone. The same seed gives the same policy.

    Args:
        model: whose observations and actions are those of RimlessWheel-v0.
        expert: the controller to imitate, in volts.
        params: the machine.
        config: default `Cloning()`.
        seed: of starts and batches.
        progress: whether to show a progress bar.
    """
    config = config or Cloning()
    rng = np.random.default_rng((seed, 1))
    label = controller_policy(params, expert)
    mean_action, weights = actor_of(model)
    total = (config.rounds + 1) * config.gradient_steps
    optimizer = torch.optim.Adam(weights, lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, total)
    train: list[tuple[Observations, Floats]] = []
    test: list[tuple[Observations, Floats]] = []
    errors = []
    with tqdm(total=total, desc="clone", disable=not progress, leave=False) as bar:
        for k in range(config.rounds):
            walker = label if k == 0 else model_policy(model)
            n = config.starts if k else config.expert_starts
            n_test = max(1, round(config.held_out * n))
            starts = draw_starts(params, n, (seed, 2, k))
            for share, part in ((starts[:n_test], test), (starts[n_test:], train)):
                labels = round(config.labels * len(share) / n)
                part.append(
                    labelled_walks(params, walker, label, share, config.seconds, labels, rng)
                )
            observations, targets = _tensors(train)
            last = k == config.rounds - 1
            for _ in range(config.gradient_steps * (2 if last else 1)):
                batch = torch.from_numpy(rng.integers(len(targets), size=config.batch_size))
                loss = nn.functional.huber_loss(
                    mean_action(observations[batch]), targets[batch], delta=config.huber
                )
                optimizer.zero_grad(set_to_none=True)
                loss.backward()
                optimizer.step()
                schedule.step()
                bar.update()
            observations, targets = _tensors(test)
            with torch.no_grad():
                errors.append(
                    float(nn.functional.mse_loss(mean_action(observations), targets).sqrt())
                )
            bar.set_postfix(error=f"{errors[-1]:.4f}")
    set_exploration(model, config.log_std)
    return CloneReport(sum(len(t) for _, t in train + test), tuple(errors))


def labelled_walks(
    params: WheelParams,
    walker: Policy,
    label: Policy,
    starts: Floats,
    seconds: float,
    labels: Sequence[int],
    rng: np.random.Generator,
) -> tuple[Observations, Floats]:
    """Observations (M, 6) that `walker` meets from `starts`, with the action of `label`, (M,).

    All of them where `walker` is `label`, else as many, drawn at random, as `labels` says for
    each of the equal parts into which it divides the walks.
    """
    intervals = list(rollout(params, walker, starts, round(seconds / CONTROL_PERIOD)))
    if walker is label:
        return _stacked(intervals, "observations"), _stacked(intervals, "actions")
    observations, targets = [], []
    for part, count in zip(
        np.array_split(np.arange(len(intervals)), len(labels)), labels, strict=True
    ):
        walked = [intervals[i] for i in part]
        if not walked:
            continue
        states = _stacked(walked, "states")
        some = rng.permutation(len(states))[:count]
        observations.append(_stacked(walked, "observations")[some])
        targets.append(label(states[some], observations[-1]))
    return np.concatenate(observations), np.concatenate(targets)


def _stacked(intervals: list[Interval], name: str) -> Any:
    return np.concatenate([getattr(interval, name) for interval in intervals])


def _tensors(walks: list[tuple[Observations, Floats]]) -> tuple[torch.Tensor, torch.Tensor]:
    observations = np.concatenate([o for o, _ in walks])
    targets = np.concatenate([t for _, t in walks]).astype(np.float32)
    return torch.from_numpy(observations), torch.from_numpy(targets)


def actor_of(
    model: Any,
) -> tuple[Callable[[torch.Tensor], torch.Tensor], list[nn.Parameter]]:
    """The deterministic action (N,) as a differentiable function of observations, its weights."""
    policy = model.policy
    if hasattr(policy, "actor"):  # SAC
        actor = policy.actor
        modules: list[nn.Module] = [actor.latent_pi, actor.mu]

        def mean_action(observations: torch.Tensor) -> torch.Tensor:
            return torch.tanh(actor.mu(actor.latent_pi(observations)))[:, 0]

    else:
        modules = [policy.mlp_extractor.policy_net, policy.action_net]

        def mean_action(observations: torch.Tensor) -> torch.Tensor:
            latent = policy.mlp_extractor.forward_actor(observations)
            return policy.action_net(latent)[:, 0]

    return mean_action, [p for module in modules for p in module.parameters()]


def set_exploration(model: Any, log_std: float) -> None:
    """Make a model's exploration noise the same in all states."""
    policy = model.policy
    with torch.no_grad():
        if hasattr(policy, "actor"):
            policy.actor.log_std.weight.zero_()
            policy.actor.log_std.bias.fill_(log_std)
        else:
            policy.log_std.fill_(log_std)
