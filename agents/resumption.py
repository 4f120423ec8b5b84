"""The full state of a training in a file, from which it goes on after being killed at any time.

A resumed training does exactly what it would have done without a break, to the last bit. The state
is that between two roll-outs: policy, optimisers, counters, replay buffer, environments and every
random generator.
"""

from __future__ import annotations

import random
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.save_util import recursive_getattr

from agents.training_env import environments_state, set_environments_state
from agents.trees import from_arrays, to_arrays
from trajopt.files import read_arrays, write_arrays

FORMAT = "rimless-gym training 1"

#: Counters and rates of stable-baselines3's algorithms that outlast a roll-out.
COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")

#: The columns of a replay buffer.
REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


class StateError(ValueError):
    """A state is damaged, or does not fit the training that is to go on."""


def save_state(path: Path, model: Any, notes: dict[str, Any]) -> None:
    """Write the state of a learning `model`; the file is complete or left as it was.

    Args:
        path: of the file.
        model: PPO or SAC in a `training_env`, between two roll-outs.
        notes: plain values to keep beside it.

    Raises:
        OSError: the disk is full, or the folder cannot be written; the last state is kept.
    """
    plain, arrays = to_arrays({"model": _state_of(model), "notes": notes})
    write_arrays(path, FORMAT, {"tree": plain}, arrays)


def load_state(path: Path) -> dict[str, Any]:
    """What `save_state` wrote: the "model"'s state and the "notes".

    Raises:
        StateError: the file is damaged.
    """
    remedy = "delete it to begin this training anew, or choose another --out"
    header, arrays = read_arrays(path, FORMAT, StateError, remedy)
    try:
        state = from_arrays(header["tree"], arrays)
        if set(state) != {"model", "notes"}:
            raise ValueError(f"it has the parts {list(state)}")
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise StateError(f"{path}: damaged ({error!r}); {remedy}") from error
    return dict(state)


def restore(model: Any, state: dict[str, Any]) -> None:
    """Put a new model, made with the same settings, into a state from `load_state`.

    Raises:
        StateError: the state is from another kind of model or another number of environments.
    """
    try:
        parameters = state["parameters"]
        if not isinstance(parameters, dict):  # of a path, it would read the file there
            raise TypeError(f"its parameters are a {type(parameters).__name__}")
        if not set(state["counters"]) <= set(COUNTERS):
            raise ValueError(f"it has the counters {list(state['counters'])}")
        model.set_parameters(parameters, exact_match=True)
        for name, value in state["variables"].items():
            recursive_getattr(model, name).data.copy_(value)
        for name, value in state["counters"].items():
            setattr(model, name, value)
        model.ep_info_buffer = deque(state["episodes"], maxlen=model._stats_window_size)
        model.ep_success_buffer = deque(maxlen=model._stats_window_size)
        model._last_obs = state["last_observations"]
        model._last_episode_starts = state["last_starts"]
        if state["replay"] is not None:
            _restore_replay(model.replay_buffer, state["replay"])
        set_environments_state(model.env, state["environments"])
        _restore_generators(model, state["generators"])
    except Exception as error:  # stable-baselines3 and torch raise almost anything
        raise StateError(
            f"the state does not fit this training ({error!r}): go on with the versions that "
            "began it, or begin another with another --out"
        ) from error


def _state_of(model: Any) -> dict[str, Any]:
    _, variables = model._get_torch_save_params()
    replay = getattr(model, "replay_buffer", None)
    return {
        "parameters": model.get_parameters(),
        "variables": {name: recursive_getattr(model, name) for name in variables},
        "counters": {name: getattr(model, name) for name in COUNTERS if hasattr(model, name)},
        "episodes": model.ep_info_buffer,
        "last_observations": model._last_obs,
        "last_starts": model._last_episode_starts,
        "replay": None if replay is None else _replay_of(replay),
        "environments": environments_state(model.env),
        "generators": {
            "torch": torch.get_rng_state(),
            "numpy": np.random.get_state(legacy=False),  # noqa: NPY002  stable-baselines3's
            "python": random.getstate(),
            "actions": model.action_space.np_random.bit_generator.state,
        },
    }


def _restore_generators(model: Any, generators: dict[str, Any]) -> None:
    torch.set_rng_state(generators["torch"])
    np.random.set_state(generators["numpy"])  # noqa: NPY002
    version, words, gauss = generators["python"]
    random.setstate((version, tuple(words), gauss))
    model.action_space.np_random.bit_generator.state = generators["actions"]


def _replay_of(buffer: Any) -> dict[str, Any]:
    size = buffer.size()
    columns = {name: getattr(buffer, name)[:size] for name in REPLAY}
    return {"columns": columns, "position": buffer.pos, "full": buffer.full}


def _restore_replay(buffer: Any, state: dict[str, Any]) -> None:
    for name in REPLAY:
        column = state["columns"][name]
        getattr(buffer, name)[: len(column)] = column
    buffer.pos, buffer.full = state["position"], state["full"]
