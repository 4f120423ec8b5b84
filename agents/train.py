"""Training PPO and SAC, from scratch or from a clone of the optimal gait's controller."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Callable
from operator import index
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.logger import configure

from agents.callbacks import Freeze, KeepBest, LogWalking, Progress
from agents.checkpoint import ALGORITHMS, load_checkpoint, read_record, save_checkpoint
from agents.evaluate import SHORT_PROTOCOL, Evaluation, Protocol
from agents.expert import gait_expert
from agents.hyperparameters import Hyperparameters, hyperparameters
from agents.imitate import Cloning, clone
from agents.policies import Controller
from agents.training_env import training_env
from rimless_gym.envs.task import Task
from rimless_gym.params import THESIS_PHYSICAL, WheelParams
from trajopt import periodic_gait
from trajopt.provenance import provenance

INITS = ("scratch", "imitation")

#: The gait that is imitated where no expert is given.
EXPERT_SPEED, EXPERT_STEPS = 0.5, 1

#: Share of a fine-tuning in which only the critic learns.
CRITIC_WARM_UP = 0.15

#: What a training leaves in its folder, besides clone.zip and TensorBoard's events.
NOTES, BEST, LAST, REPLAY = "train.json", "best.zip", "last.zip", "replay.pkl"

#: The largest that numpy's global generator takes.
MAX_SEED = 2**32 - 1

#: Evaluations of a training, besides the one at its start.
EVALUATIONS = 10


@dataclasses.dataclass(frozen=True)
class TrainResult:
    """Where a training left its policies.

    Attributes:
        best: checkpoint that did best in the periodic evaluations.
        last: checkpoint to resume from.
        clone: the clone that it began from, if it did.
        timesteps: environment steps so far.
        interrupted: whether Ctrl-C ended it.
        evaluations: (timesteps, evaluation) pairs of this run, by the short protocol.
    """

    best: Path
    last: Path
    clone: Path | None
    timesteps: int
    interrupted: bool
    evaluations: tuple[tuple[int, Evaluation], ...]


def train(
    algo: str,
    init: str | Path = "scratch",
    seed: int = 0,
    out: str | Path = "runs/train",
    *,
    timesteps: int | None = None,
    resume: bool = False,
    params: WheelParams = THESIS_PHYSICAL,
    task: Task | None = None,
    expert: Controller | None = None,
    cloning: Cloning | None = None,
    score: Callable[[Evaluation], float] | None = None,
    protocol: Protocol = SHORT_PROTOCOL,
    progress: bool = True,
) -> TrainResult:
    """Train a policy into a folder: best.zip, last.zip, train.json, TensorBoard events.

    The same seed gives the same policy. torch runs on one thread, for sums depend on how they are
    split, and these networks are too small for more to pay. Ctrl-C saves and returns.

    Args:
        algo: "ppo" or "sac".
        init: "scratch", "imitation" (clone `expert` first), or a checkpoint to start from.
        seed: of everything random, from 0 to 2**32 - 1.
        out: folder; must not hold another training unless `resume`.
        timesteps: environment steps in all, resumed ones included; default: hyperparams/*.yml.
        resume: go on from last.zip. Episodes begin anew; SAC's replay buffer is kept.
        params: the machine.
        task: the reward, default `Task()`.
        expert: to imitate; default: LQR about the optimal gait at 0.5 m/s.
        cloning: how, default `Cloning()`.
        score: what "best" means, larger is better; default: reward per second.
        protocol: of the periodic evaluations.
        progress: whether to show progress bars.

    Raises:
        ValueError: an argument is out of range, or `out` is a file or holds another training.
        TypeError: seed or timesteps is not an integer.
        CheckpointError: a checkpoint to start or resume from does not fit.
    """
    torch.set_num_threads(1)
    task, out = task or Task(), Path(out)
    imitation = str(init) != "scratch"
    settings = hyperparameters(algo, imitation)
    seed = _integer("seed", seed, MAX_SEED)
    total = settings.n_timesteps if timesteps is None else _integer("timesteps", timesteps)
    silent = int(settings.algorithm.get("learning_starts", 0))
    if 0 < total <= silent:
        raise ValueError(
            f"timesteps = {total}: {algo} only collects experience for the first {silent} "
            "(learning_starts in agents/hyperparams); ask for more"
        )
    notes: dict[str, Any] = {"algo": algo, "init": str(init), "seed": seed}
    notes |= {"params": params.to_dict(), "task": dataclasses.asdict(task)}
    last, best, clone_path = out / LAST, out / BEST, out / "clone.zip"
    best_score = _check_folder(out, notes, resume)
    env = training_env(settings.n_envs, params, task, seed, settings.reward_scale)

    if resume:
        model = load_checkpoint(last, params, env).model
        if (out / REPLAY).exists() and hasattr(model, "load_replay_buffer"):
            _load_replay_buffer(model, out / REPLAY)
    elif str(init) in INITS:
        model = ALGORITHMS[algo](env=env, seed=seed, device="cpu", **settings.algorithm)
        if imitation:
            if expert is None:
                expert = gait_expert(
                    periodic_gait(params, EXPERT_SPEED, EXPERT_STEPS, progress=progress)
                )
            report = clone(model, expert, params, cloning, seed=seed, progress=progress)
            save_checkpoint(
                clone_path, model, params, task, seed, cloning=dataclasses.asdict(report)
            )
    else:
        model = _started_from(Path(init), algo, settings, params, env, seed)
    model.set_logger(configure(str(out), ["tensorboard"]))

    def keep(evaluation: Evaluation, score: float) -> None:
        figures = {"score": score, "evaluation": evaluation.to_dict()}
        save_checkpoint(best, model, params, task, seed, **figures)
        _write_notes(out, notes, settings, score)

    every = max(1, math.ceil(total / EVALUATIONS))
    keeper = KeepBest(params, task, every, keep, score, best_score, protocol)
    bar = Progress(total, f"{algo} {Path(init).stem}", progress)
    callbacks = [LogWalking(params), keeper, bar]
    if imitation:
        callbacks.append(Freeze(round(CRITIC_WARM_UP * total)))
    interrupted = False
    try:
        model.learn(max(0, total - model.num_timesteps), callbacks, reset_num_timesteps=False)
    except KeyboardInterrupt:
        interrupted = True
    finally:
        bar.close()
        env.close()
    save_checkpoint(last, model, params, task, seed)
    if hasattr(model, "save_replay_buffer"):
        model.save_replay_buffer(out / REPLAY)
    _write_notes(out, notes, settings, keeper.best)
    model.logger.close()
    return TrainResult(
        best=best,
        last=last,
        clone=clone_path if clone_path.exists() else None,
        timesteps=model.num_timesteps,
        interrupted=interrupted,
        evaluations=tuple(keeper.history),
    )


def _started_from(
    path: Path,
    algo: str,
    settings: Hyperparameters,
    params: WheelParams,
    env: Any,
    seed: int,
) -> Any:
    """A new model with a checkpoint's policy: its own optimiser, schedule and seed."""
    record = read_record(path)
    if record["algo"] != algo:
        raise ValueError(
            f"{path}: a {record['algo']} policy cannot start {algo}; use one of {algo}"
        )
    start = load_checkpoint(path, params).model
    arguments = settings.algorithm | {"policy_kwargs": start.policy_kwargs}
    model = ALGORITHMS[algo](env=env, seed=seed, device="cpu", **arguments)
    model.policy.load_state_dict(start.policy.state_dict())
    return model


def _integer(name: str, value: Any, largest: float = math.inf) -> int:
    """The value as a plain int from 0 to `largest`, which JSON can hold."""
    try:
        number = index(value)
    except TypeError:
        number = None
    if number is None or isinstance(value, bool):
        raise TypeError(f"{name} = {value!r}: must be an integer")
    if not 0 <= number <= largest:
        upper = f" and at most {largest}" if math.isfinite(largest) else ""
        raise ValueError(f"{name} = {value}: must be at least 0{upper}")
    return number


def _load_replay_buffer(model: Any, path: Path) -> None:
    try:
        model.load_replay_buffer(path)
    except Exception as error:  # pickle raises almost anything
        raise ValueError(
            f"{path}: damaged ({error!r}); copy it again, or delete it to resume without what "
            "was experienced before"
        ) from error


def _check_folder(out: Path, notes: dict[str, Any], resume: bool) -> float:
    """The best score so far of the training in the folder, which must be the one wanted."""
    if out.exists() and not out.is_dir():
        raise ValueError(f"{out} is a file: choose a folder as --out")
    written = out / NOTES
    if not resume:
        if written.exists():
            raise ValueError(
                f"{out} holds a training: go on with --resume, or choose another --out"
            )
        policies = [name for name in (BEST, LAST) if (out / name).exists()]
        if policies:
            raise ValueError(
                f"{out} holds {' and '.join(policies)} but no {NOTES}: move them away, or choose "
                "another --out"
            )
        out.mkdir(parents=True, exist_ok=True)
        return -math.inf
    if not written.exists():
        raise ValueError(f"{out}: no training to resume (no {NOTES}); leave out --resume")
    before = _read_notes(written)
    for name, value in notes.items():
        if before.get(name) != value:
            raise ValueError(
                f"{out} holds a training with {name} = {before.get(name)}, not {value}: "
                "resume with the same, or choose another --out"
            )
    if not (out / LAST).exists():
        raise ValueError(
            f"{out}: its training ended before {LAST} was saved, so it cannot be resumed; start "
            f"another from {BEST} (--init {out / BEST}), with another --out"
        )
    best = before["best_score"]
    return -math.inf if best is None else float(best)


def _read_notes(path: Path) -> dict[str, Any]:
    """What `_write_notes` wrote."""
    try:
        notes = json.loads(path.read_bytes())
        if not isinstance(notes, dict):
            raise TypeError(f"{type(notes).__name__} instead of an object")
        best = notes["best_score"]
        if best is not None and not math.isfinite(best):
            raise ValueError(f"best_score = {best}")
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(
            f"{path}: damaged ({error!r}), so its training cannot be resumed; start another from "
            f"{path.with_name(BEST)} (--init), with another --out"
        ) from error
    return notes


def _write_notes(
    out: Path, notes: dict[str, Any], settings: Hyperparameters, best_score: float
) -> None:
    best = best_score if math.isfinite(best_score) else None
    values = {**notes, "hyperparameters": settings.written, "best_score": best}
    part = out / f"{NOTES}.part"
    part.write_text(json.dumps(values | provenance(), indent=1) + "\n")
    os.replace(part, out / NOTES)
