"""Policy files: weights and a record of what they were trained for, nothing else.

A file is an archive of plain arrays with a JSON record and a digest (`trajopt.files`). Reading it
executes nothing: the loader builds the stable-baselines3 model itself and puts the weights in.
Files written by plain stable-baselines3 are pickles, which can run any code.
"""

from __future__ import annotations

import dataclasses
import zipfile
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO, SAC

from agents.hyperparameters import ACTIVATIONS
from agents.training_env import training_env
from rimless_gym.envs import task as walking
from rimless_gym.envs.task import Task
from rimless_gym.params import THESIS_PHYSICAL, WheelParams
from trajopt.files import digest, jsonable, read_arrays, write_arrays
from trajopt.provenance import provenance

FORMAT = "rimless-gym policy 2"
ALGORITHMS: dict[str, Any] = {"ppo": PPO, "sac": SAC}

#: Policies that come with the package, by name.
PRETRAINED = {
    path.stem: path for path in sorted((Path(__file__).parent / "pretrained").glob("*.zip"))
}

#: What plain stable-baselines3 puts into its files.
_FOREIGN = ("data", "policy.pth")

#: What a policy sees; one trained on another layout is not loaded.
OBSERVATION_LAYOUT = (
    "(phi - pi/2) / (alpha/2)",
    "sin theta",
    "cos theta",
    f"phi' / {walking.LEG_RATE_SCALE} rad/s",
    f"theta' / {walking.PENDULUM_RATE_SCALE} rad/s",
    "resting",
)

_REMEDY = "copy it again, or train it again with scripts/train.py"


class CheckpointError(ValueError):
    """A policy file is missing, damaged, in another format, or for another machine or layout."""


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """A loaded policy.

    Attributes:
        model: the stable-baselines3 model, whose `predict` takes observations of the environment.
            Its settings of learning are stable-baselines3's defaults.
        algo: "ppo" or "sac".
        params: the machine that it was trained on.
        task: the reward that it was trained for.
        seed: of the training.
        record: everything that was saved with the weights.
    """

    model: Any
    algo: str
    params: WheelParams
    task: Task
    seed: int
    record: dict[str, Any]


def save_policy(
    path: str | Path, model: Any, params: WheelParams, task: Task, seed: int, **notes: Any
) -> Path:
    """Write a model's weights with their record; the file is complete or left as it was.

    Args:
        path: of the file, .zip.
        model: PPO or SAC with an "MlpPolicy".
        params: the machine.
        task: the reward.
        seed: of the training.
        notes: plain JSON values to record beside these.

    Returns:
        The path.

    Raises:
        CheckpointError: the model is of another kind, or its networks cannot be written as JSON.
        OSError: the file cannot be written; one that was there is kept.
    """
    algo = next((name for name, kind in ALGORITHMS.items() if isinstance(model, kind)), None)
    if algo is None:
        raise CheckpointError(f"model = {type(model).__name__}: must be one of {list(ALGORITHMS)}")
    if type(model.policy) is not ALGORITHMS[algo].policy_aliases["MlpPolicy"]:
        raise CheckpointError(
            f"policy = {type(model.policy).__name__}: only an MlpPolicy is kept in a policy file"
        )
    versions = {name: version(name) for name in ("torch", "stable-baselines3", "gymnasium")}
    made_by = provenance()
    record = {
        "algo": algo,
        "policy_kwargs": architecture(model),
        "seed": seed,
        "timesteps": model.num_timesteps,
        "observation_layout": list(OBSERVATION_LAYOUT),
        "params": params.to_dict(),
        "task": dataclasses.asdict(task),
        "versions": made_by["versions"] | versions,
        "git_revision": made_by["git_revision"],
        **notes,
    }
    weights = {name: w.detach().cpu().numpy() for name, w in model.policy.state_dict().items()}
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_arrays(path, FORMAT, record, weights)
    return path


def architecture(model: Any) -> dict[str, Any]:
    """The `policy_kwargs` of a model as JSON values, the activation by its name.

    Raises:
        CheckpointError: they hold something that JSON cannot.
    """
    named = {kind: name for name, kind in ACTIVATIONS.items()}
    kwargs = dict(model.policy_kwargs)
    # SAC puts this one in by itself.
    kwargs = {k: v for k, v in kwargs.items() if not (k == "use_sde" and v is False)}
    activation = kwargs.get("activation_fn")
    if activation is not None:
        if activation not in named:
            raise CheckpointError(f"activation_fn = {activation}: choose from {list(ACTIVATIONS)}")
        kwargs["activation_fn"] = named[activation]
    wrong = [k for k, v in kwargs.items() if not _is_plain(v)]
    if wrong:
        raise CheckpointError(f"policy_kwargs {wrong}: only plain values are kept in a policy file")
    return dict(jsonable(kwargs))


def _is_plain(value: Any) -> bool:
    if isinstance(value, dict):
        return all(isinstance(key, str) and _is_plain(item) for key, item in value.items())
    if isinstance(value, list | tuple):
        return all(_is_plain(item) for item in value)
    return value is None or isinstance(value, bool | int | float | str)


def built(algo: str, policy_kwargs: dict[str, Any], env: Any, **arguments: Any) -> Any:
    """A new model with the networks that `architecture` described.

    Args:
        algo: "ppo" or "sac".
        policy_kwargs: from `architecture`.
        env: to learn in.
        arguments: any others for the algorithm.
    """
    kwargs = dict(policy_kwargs)
    if "activation_fn" in kwargs:
        kwargs["activation_fn"] = ACTIVATIONS[kwargs["activation_fn"]]
    arguments = {"policy": "MlpPolicy", "device": "cpu"} | arguments
    return ALGORITHMS[algo](env=env, policy_kwargs=kwargs, **arguments)


def find_policy(path: str | Path) -> Path:
    """The file at `path`, or the one that comes with the package under that name.

    Raises:
        CheckpointError: neither exists.
    """
    found = Path(path)
    for file in (found, Path(f"{path}.zip")):  # as stable-baselines3 names what it saves
        if file.is_file():
            return file
    if str(path) in PRETRAINED:
        return PRETRAINED[str(path)]
    if found.is_dir():
        raise CheckpointError(f"{path}: a folder; give the .zip file in it, such as best.zip")
    raise CheckpointError(
        f"{path}: no such file, and no policy of that name comes with the package (those are "
        f"{', '.join(PRETRAINED)}); make one with scripts/train.py, or check the path"
    )


def read_record(path: str | Path) -> dict[str, Any]:
    """The record of a policy file; raises what `load_policy` raises."""
    return _read(find_policy(path))[0]


def origin(path: str | Path) -> str:
    """A policy to start from, in words: its algorithm and a digest of its weights.

    Raises:
        CheckpointError: it cannot be read.
    """
    record, weights = _read(find_policy(path))
    return f"{record.get('algo')} policy, SHA-256 of its weights {digest(weights)[:16]}"


def load_policy(
    path: str | Path, params: WheelParams | None = None, *, trust_pickle: bool = False
) -> Checkpoint:
    """Load a policy, if it is for this observation layout and this machine.

    Args:
        path: of the file; or the name of a policy that comes with the package (`PRETRAINED`).
        params: the machine to walk on; default: the one the policy was trained on.
        trust_pickle: also read files of plain stable-baselines3. Such a file is a pickle: reading
            it runs any code that its author put into it, with your rights. It does not record its
            machine, which is taken to be `params`, or the default machine if that is None.

    Raises:
        CheckpointError: there is no such file, it is damaged or in another format, or its
            observations or machine differ from those wanted.
    """
    path = find_policy(path)
    if trust_pickle and _is_foreign(path):
        return _unpickled(path, params or THESIS_PHYSICAL)
    record, weights = _read(path)
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
        if algo not in ALGORITHMS:
            raise ValueError(f"algo = {algo!r}: must be one of {list(ALGORITHMS)}")
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise CheckpointError(
            f"{path}: its record is incomplete or invalid: {error!r}; {_REMEDY}"
        ) from error
    if params is not None and params != trained_on:
        wanted, has = params.to_dict(), trained_on.to_dict()
        differing = {k: f"{has[k]} (not {wanted[k]})" for k in has if has[k] != wanted[k]}
        raise CheckpointError(
            f"{path}: trained on another machine: {differing}; to try it on this one all the "
            "same, load it without params"
        )
    try:
        model = built(algo, record["policy_kwargs"], training_env(1, trained_on, task, seed=0))
        model.policy.load_state_dict({name: torch.from_numpy(w) for name, w in weights.items()})
        model.num_timesteps = int(record["timesteps"])
    except Exception as error:  # torch and stable-baselines3 raise almost anything
        raise CheckpointError(
            f"{path}: its record says {algo}, but its weights do not fit a {algo} policy "
            f"({error!r}), so it was edited or damaged; {_REMEDY}"
        ) from error
    model.policy.set_training_mode(False)
    return Checkpoint(model, algo, trained_on, task, seed, record)


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """The record and the weights."""
    if _is_foreign(path):
        raise CheckpointError(
            f"{path}: a file of plain stable-baselines3, which is a pickle: reading it can run any "
            "code that its author put into it; if you trust the author, load it with "
            "trust_pickle=True (on the command line --trust-pickle)"
        )
    record, weights = read_arrays(path, FORMAT, CheckpointError, _REMEDY)
    wrong = [name for name, w in weights.items() if w.dtype.kind != "f" or not np.isfinite(w).all()]
    if wrong:
        raise CheckpointError(
            f"{path}: edited: the numbers in {wrong} are not all finite; {_REMEDY}"
        )
    return record, weights


def _is_foreign(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return set(_FOREIGN) <= set(archive.namelist())
    except (OSError, zipfile.BadZipFile):
        return False


def _unpickled(path: Path, params: WheelParams) -> Checkpoint:
    """The model in a file of plain stable-baselines3, PPO or SAC."""
    env = training_env(1, params, Task(), seed=0)
    causes = []
    for algo, kind in ALGORITHMS.items():
        try:
            model = kind.load(path, env=env, device="cpu")
        except Exception as error:  # unpickling can raise anything
            causes.append(f"{algo}: {error!r}")
        else:
            return Checkpoint(model, algo, params, Task(), 0, {"algo": algo})
    raise CheckpointError(f"{path}: neither a PPO nor a SAC model ({'; '.join(causes)})")
