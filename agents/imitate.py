"""Behaviour cloning of a controller into a stable-baselines3 policy, with DAgger.

The first round learns from the expert's own walks; in the later ones the clone walks and the
expert says what it would have done (Ross, Gordon and Bagnell, AISTATS 2011), so that the clone
learns to get out of its own mistakes.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from tqdm import tqdm

from agents.policies import Controller, Floats, Policy, controller_policy, model_policy
from agents.rollout import draw_starts, rollout
from agents.trees import from_arrays, to_arrays
from rimless_gym.checks import integer, positive, real
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from trajopt.files import read_arrays, write_arrays

FORMAT = "rimless-gym cloning 1"

#: Observations (M, 6) and actions (M,), float32.
Labelled: TypeAlias = tuple[torch.Tensor, torch.Tensor]


class CloningError(ValueError):
    """The file with the rounds done so far is damaged, or belongs to another cloning."""


@dataclasses.dataclass(frozen=True)
class Cloning:
    """How to clone.

    Attributes:
        rounds: of DAgger, the expert's own included.
        expert_starts: random starts that the expert walks from in the first round.
        seconds: length of each walk (s).
        starts: random starts that the clone walks from in each later round.
        labels: states of these walks that the expert labels, per round.
        gait_starts: starts of the clone among the states where the expert's walks ended up: most
            of what decides the cost of transport is near the gait.
        gait_labels: states of these walks that the expert labels, per round.
        gradient_steps: in each round; twice as many in the last.
        batch_size: observations per gradient step.
        huber: error (in units of the voltage limit) above which the loss grows only linearly:
            where the expert switches, no smooth network follows, and near the gait all counts.
        learning_rate: at the beginning; it falls to 0 along a cosine over all rounds.
        log_std: natural logarithm of the cloned policy's exploration noise.
        held_out: share of the walks kept for measuring the error.

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: a number is out of its range.
    """

    rounds: int = 4
    expert_starts: int = 64
    seconds: float = 6.0
    starts: int = 256
    labels: int = 8_000
    gait_starts: int = 64
    gait_labels: int = 24_000
    gradient_steps: int = 1500
    batch_size: int = 1024
    learning_rate: float = 2e-3
    huber: float = 0.05
    log_std: float = -4.5
    held_out: float = 0.1

    def __post_init__(self) -> None:
        for name in ("rounds", "expert_starts", "starts", "gait_starts", "batch_size"):
            integer(name, getattr(self, name), 1)
        for name in ("labels", "gait_labels", "gradient_steps"):
            integer(name, getattr(self, name), 0)
        for name in ("seconds", "learning_rate", "huber"):
            positive(name, getattr(self, name))
        if self.seconds < 2 * CONTROL_PERIOD:
            raise ValueError(
                f"seconds = {self.seconds}: must be at least two periods of control, "
                f"{2 * CONTROL_PERIOD} s"
            )
        real("log_std", self.log_std)
        if not 0 < real("held_out", self.held_out) < 1:
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
    kept: Path | None = None,
    progress: bool = False,
) -> CloneReport:
    """Train the actor of a stable-baselines3 PPO or SAC `model` to act as `expert` does.

    The model is changed in place; its critic is left alone. The same seed gives the same policy,
    even if the cloning was stopped and goes on from the rounds in `kept`.

    Args:
        model: whose observations and actions are those of RimlessWheel-v0.
        expert: the controller to imitate, in volts.
        params: the machine.
        config: default `Cloning()`.
        seed: of starts and batches.
        kept: file to which each finished round is saved. It stays: whoever saves the model
            removes it then.
        progress: whether to show a progress bar.

    Raises:
        CloningError: `kept` is damaged, or belongs to another cloning.
    """
    config = config or Cloning()
    rng = np.random.default_rng((seed, 1))
    label = controller_policy(params, expert)
    mean_action, weights = actor_of(model)
    total = (config.rounds + 1) * config.gradient_steps
    optimizer = torch.optim.Adam(weights, lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, total)
    n_intervals = round(config.seconds / CONTROL_PERIOD)
    learning = {"policy": model.policy, "optimizer": optimizer, "schedule": schedule}
    walks: list[Walks] = []
    errors: list[float] = []
    if kept is not None and kept.exists():
        walks, errors = _restore(kept, config, seed, learning, rng)
    with tqdm(total=total, desc="clone", disable=not progress, leave=False) as bar:
        bar.update(len(errors) * config.gradient_steps)
        for k in range(len(errors), config.rounds):
            if k == 0:
                starts = draw_starts(params, config.expert_starts, (seed, 2))
                walks.append(walk(params, label, starts, n_intervals))
            else:
                learner = model_policy(model)
                first = walks[0]
                gait = first.states[first.when >= n_intervals // 2]
                anywhere = draw_starts(params, config.starts, (seed, 2, k))
                near = gait[rng.integers(len(gait), size=config.gait_starts)]
                for starts, count in ((anywhere, config.labels), (near, config.gait_labels)):
                    seen = walk(params, learner, starts, n_intervals)
                    some = seen.take(rng.permutation(len(seen.when))[:count])
                    walks.append(some._replace(actions=label(some.states, some.observations)))
            learned, held_out = _split(walks, config.held_out)
            for _ in range(config.gradient_steps * (2 if k == config.rounds - 1 else 1)):
                batch = torch.from_numpy(rng.integers(len(learned[1]), size=config.batch_size))
                loss = nn.functional.huber_loss(
                    mean_action(learned[0][batch]), learned[1][batch], delta=config.huber
                )
                optimizer.zero_grad(set_to_none=True)
                loss.backward()
                optimizer.step()
                schedule.step()
                bar.update()
            with torch.no_grad():
                error = nn.functional.mse_loss(mean_action(held_out[0]), held_out[1]).sqrt()
            errors.append(float(error))
            bar.set_postfix(error=f"{errors[-1]:.4f}")
            if kept is not None:
                _keep(kept, config, seed, learning, rng, walks, errors)
    set_exploration(model, config.log_std)
    return CloneReport(sum(len(seen.when) for seen in walks), tuple(errors))


class Walks(NamedTuple):
    """Control intervals of several walks, one after the other.

    Attributes:
        which: index of the start, (M,).
        when: index of the interval, (M,).
        states: (M, STATE_SIZE).
        observations: (M, 6).
        actions: in units of the voltage limit, (M,).
    """

    which: NDArray[np.int64]
    when: NDArray[np.int64]
    states: Floats
    observations: NDArray[np.float32]
    actions: Floats

    def take(self, indices: NDArray[np.int64]) -> Walks:
        """Some of the intervals."""
        return Walks._make(values[indices] for values in self)


def walk(params: WheelParams, policy: Policy, starts: Floats, n_intervals: int) -> Walks:
    """What a policy meets and does from `starts` (N, STATE_SIZE)."""
    intervals = list(rollout(params, policy, starts, n_intervals))
    return Walks(
        which=np.concatenate([interval.running for interval in intervals]),
        when=np.repeat(np.arange(len(intervals)), [len(i.running) for i in intervals]),
        states=np.concatenate([interval.states for interval in intervals]),
        observations=np.concatenate([interval.observations for interval in intervals]),
        actions=np.concatenate([interval.actions for interval in intervals]),
    )


def _keep(
    path: Path,
    config: Cloning,
    seed: int,
    learning: dict[str, Any],
    rng: np.random.Generator,
    walks: list[Walks],
    errors: list[float],
) -> None:
    """Write everything that the next round needs."""
    state = {
        "learning": {name: part.state_dict() for name, part in learning.items()},
        "generator": rng.bit_generator.state,
        "walks": [seen._asdict() for seen in walks],
        "errors": errors,
    }
    tree, arrays = to_arrays(state)
    of = {"config": dataclasses.asdict(config), "seed": seed}
    write_arrays(path, FORMAT, {"of": of, "tree": tree}, arrays)


def _restore(
    path: Path, config: Cloning, seed: int, learning: dict[str, Any], rng: np.random.Generator
) -> tuple[list[Walks], list[float]]:
    """The walks and errors of the rounds in a file; `learning` and `rng` are put into its state."""
    remedy = "delete it to begin the cloning anew"
    header, arrays = read_arrays(path, FORMAT, CloningError, remedy)
    try:
        if header["of"] != {"config": dataclasses.asdict(config), "seed": seed}:
            raise ValueError(f"it belongs to another cloning: {header['of']}")
        state = from_arrays(header["tree"], arrays)
        for name, part in learning.items():
            part.load_state_dict(state["learning"][name])
        rng.bit_generator.state = state["generator"]
        return [Walks(**seen) for seen in state["walks"]], list(state["errors"])
    except (KeyError, TypeError, ValueError, RuntimeError, AttributeError) as error:
        raise CloningError(f"{path}: {error!r}; {remedy}") from error


def _split(walks: list[Walks], held_out: float) -> tuple[Labelled, Labelled]:
    """Observations and actions to learn from, and those of one start in every 1 / held_out."""
    kept = np.concatenate([seen.which % round(1 / held_out) == 0 for seen in walks])
    observations = np.concatenate([seen.observations for seen in walks])
    actions = np.concatenate([seen.actions for seen in walks]).astype(np.float32)
    learned, tested = (
        (torch.from_numpy(observations[part]), torch.from_numpy(actions[part]))
        for part in (~kept, kept)
    )
    return learned, tested


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
