"""Checkpoints: a stable-baselines3 model in one zip file, with a record of what it was made for.

The record, `rimless_gym.json` within the zip, is read and compared before anything is unpickled;
still, load only checkpoints from people you trust: stable-baselines3 unpickles part of them.
"""

from __future__ import annotations

import dataclasses
import json
import os
import zipfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

from stable_baselines3 import PPO, SAC

from rimless_gym import task as walking
from rimless_gym.params import WheelParams
from rimless_gym.task import Task
from trajopt.provenance import provenance

RECORD = "rimless_gym.json"
FORMAT = "rimless-gym policy"
FORMAT_VERSION = 1
ALGORITHMS: dict[str, Any] = {"ppo": PPO, "sac": SAC}

#: What a policy sees; one trained on another layout is not loaded.
OBSERVATION_LAYOUT = (
    "(phi - pi/2) / (alpha/2)",
    "sin theta",
    "cos theta",
    f"phi' / {walking.LEG_RATE_SCALE} rad/s",
    f"theta' / {walking.PENDULUM_RATE_SCALE} rad/s",
    "resting",
)


class CheckpointError(ValueError):
    """A checkpoint is missing, not ours, damaged, or made for something else."""


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """A loaded policy.

    Attributes:
        model: the stable-baselines3 model.
        algo: "ppo" or "sac".
        params: the machine that it was trained on.
        task: the reward that it was trained for.
        seed: of the training.
        record: everything that was written beside it.
    """

    model: Any
    algo: str
    params: WheelParams
    task: Task
    seed: int
    record: dict[str, Any]


def save_checkpoint(
    path: str | Path, model: Any, params: WheelParams, task: Task, seed: int, **notes: Any
) -> Path:
    """Write a model with its record, whole or not at all.

    Args:
        path: of the zip file.
        model: PPO or SAC.
        params: the machine.
        task: the reward.
        seed: of the training.
        notes: plain JSON values to record beside these.

    Returns:
        The path.

    Raises:
        CheckpointError: the model is neither PPO nor SAC.
    """
    algo = next((name for name, kind in ALGORITHMS.items() if isinstance(model, kind)), None)
    if algo is None:
        raise CheckpointError(f"model = {type(model).__name__}: must be one of {list(ALGORITHMS)}")
    versions = {name: version(name) for name in ("torch", "stable-baselines3", "gymnasium")}
    made_by = provenance()
    record = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "algo": algo,
        "seed": seed,
        "timesteps": model.num_timesteps,
        "observation_layout": list(OBSERVATION_LAYOUT),
        "params": params.to_dict(),
        "task": dataclasses.asdict(task),
        "versions": made_by["versions"] | versions,
        "git_revision": made_by["git_revision"],
        **notes,
    }
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        model.save(file)
    with zipfile.ZipFile(part, "a") as archive:
        archive.writestr(RECORD, json.dumps(record, indent=1))
    os.replace(part, path)
    return path


def read_record(path: str | Path) -> dict[str, Any]:
    """The record of a checkpoint.

    Raises:
        CheckpointError: the file is missing, damaged, or not one of ours.
    """
    path = Path(path)
    if not path.is_file():
        raise CheckpointError(
            f"{path}: no such file; make a policy with scripts/train.py, or check the path"
        )
    try:
        with zipfile.ZipFile(path) as archive:
            broken = archive.testzip()
            if broken is not None:
                raise CheckpointError(f"{path}: {broken} is damaged; copy or train it again")
            if RECORD not in archive.namelist():
                raise CheckpointError(
                    f"{path}: no {RECORD} in it, so not a rimless-gym policy; "
                    "save models with agents.checkpoint.save_checkpoint"
                )
            record: dict[str, Any] = json.loads(archive.read(RECORD))
    except (zipfile.BadZipFile, OSError, json.JSONDecodeError) as error:
        raise CheckpointError(
            f"{path}: damaged or not a checkpoint ({error}); copy or train it again"
        ) from error
    if record.get("format") != FORMAT or record.get("format_version") != FORMAT_VERSION:
        raise CheckpointError(
            f"{path}: format {record.get('format')!r} version {record.get('format_version')}; "
            f"this version reads {FORMAT!r} version {FORMAT_VERSION}"
        )
    return record


def load_checkpoint(
    path: str | Path, params: WheelParams | None = None, env: Any = None
) -> Checkpoint:
    """Load a policy, if it is for this observation layout and this machine.

    Args:
        path: of the zip file.
        params: the machine to walk on; default: whatever the policy was trained on.
        env: to go on training in.

    Raises:
        CheckpointError: see `read_record`; or observations or `params` differ from the record's.
    """
    record = read_record(path)
    layout = record.get("observation_layout")
    if layout != list(OBSERVATION_LAYOUT):
        raise CheckpointError(
            f"{path}: observes {layout}, but the environment now gives {list(OBSERVATION_LAYOUT)}; "
            "train it again, or use the version of rimless-gym that made it: "
            f"{record.get('git_revision')}"
        )
    try:
        trained_on = WheelParams(**record["params"])
        task, algo, seed = Task(**record["task"]), record["algo"], int(record["seed"])
        kind = ALGORITHMS[algo]
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(f"{path}: its record is incomplete or invalid: {error!r}") from error
    if params is not None and params != trained_on:
        wanted, has = params.to_dict(), trained_on.to_dict()
        differing = {k: f"{has[k]} (not {wanted[k]})" for k in has if has[k] != wanted[k]}
        raise CheckpointError(
            f"{path}: trained on another machine: {differing}; to try it on this one all the "
            "same, load it without params"
        )
    model = kind.load(path, env=env, device="cpu")
    return Checkpoint(model, algo, trained_on, task, seed, record)
