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

from rimless_gym.envs import task as walking
from rimless_gym.envs.task import Task
from rimless_gym.params import WheelParams
from trajopt.provenance import provenance

RECORD = "rimless_gym.json"
MODEL_PARTS = ("data", "policy.pth")  # what stable-baselines3 must have put beside it
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
    if path.is_dir():
        raise CheckpointError(f"{path}: a folder; give the .zip file in it, such as best.zip")
    if not path.is_file():
        raise CheckpointError(
            f"{path}: no such file; make a policy with scripts/train.py, or check the path"
        )
    try:
        with zipfile.ZipFile(path) as archive:
            broken = archive.testzip()
            if broken is not None:
                raise CheckpointError(f"{path}: {broken} is damaged; copy or train it again")
            names = archive.namelist()
            if RECORD not in names:
                raise CheckpointError(
                    f"{path}: no {RECORD} in it, so not a rimless-gym policy; "
                    "save models with agents.checkpoint.save_checkpoint"
                )
            missing = [name for name in MODEL_PARTS if name not in names]
            if missing:
                raise CheckpointError(
                    f"{path}: damaged: no {' and no '.join(missing)} in it; copy or train it again"
                )
            record: Any = json.loads(archive.read(RECORD))
    except CheckpointError:
        raise
    except Exception as error:  # a damaged archive raises almost anything
        raise CheckpointError(
            f"{path}: damaged or not a checkpoint ({error!r}); copy or train it again"
        ) from error
    if not isinstance(record, dict):
        raise CheckpointError(
            f"{path}: its {RECORD} holds {type(record).__name__}, not an object: edited or "
            "damaged; copy or train it again"
        )
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
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise CheckpointError(
            f"{path}: its record is incomplete or invalid: {error!r}; copy or train it again"
        ) from error
    if params is not None and params != trained_on:
        wanted, has = params.to_dict(), trained_on.to_dict()
        differing = {k: f"{has[k]} (not {wanted[k]})" for k in has if has[k] != wanted[k]}
        raise CheckpointError(
            f"{path}: trained on another machine: {differing}; to try it on this one all the "
            "same, load it without params"
        )
    try:
        model = kind.load(path, env=env, device="cpu")
        if type(model.policy) not in kind.policy_aliases.values():
            raise TypeError(f"its policy is a {type(model.policy).__name__}")
    except Exception as error:  # torch, pickle and stable-baselines3 raise almost anything
        raise CheckpointError(
            f"{path}: its record says {algo}, but no {algo} policy can be read from it "
            f"({error!r}): edited or damaged; copy or train it again"
        ) from error
    return Checkpoint(model, algo, trained_on, task, seed, record)
