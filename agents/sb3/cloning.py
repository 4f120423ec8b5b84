"""Behaviour cloning of a feedback law into the actor of a stable-baselines3 model."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from torch import nn
from tqdm import tqdm

from agents.imitation import CloneReport, Cloning, Teaching, Walks
from agents.sb3.networks import Actor
from agents.trees import from_arrays, to_arrays
from trajopt.files import read_arrays, write_arrays

FORMAT = "rimless-gym cloning 1"

#: Observations (M, 6) and actions (M,), float32.
Labelled: TypeAlias = tuple[torch.Tensor, torch.Tensor]


class CloningError(ValueError):
    """The file with the rounds done so far is damaged, or belongs to another cloning."""


def clone(
    actor: Actor, teaching: Teaching, *, kept: Path | None = None, progress: bool = False
) -> CloneReport:
    """Train an actor to act as an expert does.

    The model is changed in place; its critic is left alone. The same seed gives the same policy,
    even if the cloning was stopped and goes on from the rounds in `kept`.

    Args:
        actor: of a model whose observations and actions are those of RimlessWheel-v0.
        teaching: the expert, and how it teaches.
        kept: file to which each finished round is saved. It stays: whoever saves the model
            removes it then.
        progress: whether to show a progress bar.

    Raises:
        CloningError: `kept` is damaged, or belongs to another cloning.
    """
    config = teaching.config
    rng = np.random.default_rng((teaching.seed, 1))
    total = (config.rounds + 1) * config.gradient_steps
    optimizer = torch.optim.Adam(actor.weights, lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, total)
    learning = {"policy": actor.model.policy, "optimizer": optimizer, "schedule": schedule}
    walks: list[Walks] = []
    errors: list[float] = []
    if kept is not None and kept.exists():
        walks, errors = _restore(kept, config, teaching.seed, learning, rng)
    with tqdm(total=total, desc="clone", disable=not progress, leave=False) as bar:
        bar.update(len(errors) * config.gradient_steps)
        for k in range(len(errors), config.rounds):
            if k == 0:
                walks.append(teaching.first_round())
            else:
                walks.extend(teaching.later_round(k, walks[0], actor.act, rng))
            learned, held_out = _split(walks, config.held_out)
            for _ in range(config.gradient_steps * (2 if k == config.rounds - 1 else 1)):
                batch = torch.from_numpy(rng.integers(len(learned[1]), size=config.batch_size))
                loss = nn.functional.huber_loss(
                    actor.mean_action(learned[0][batch]), learned[1][batch], delta=config.huber
                )
                optimizer.zero_grad(set_to_none=True)
                loss.backward()
                optimizer.step()
                schedule.step()
                bar.update()
            with torch.no_grad():
                error = nn.functional.mse_loss(actor.mean_action(held_out[0]), held_out[1]).sqrt()
            errors.append(float(error))
            bar.set_postfix(error=f"{errors[-1]:.4f}")
            if kept is not None:
                _keep(kept, config, teaching.seed, learning, rng, walks, errors)
    actor.set_noise(config.log_std)
    return CloneReport(sum(len(seen.when) for seen in walks), tuple(errors))


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
