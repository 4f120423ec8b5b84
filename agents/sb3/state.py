"""The full state of a learning model of stable-baselines3, between two roll-outs.

It is made of policy, optimisers, counters, replay buffer, environments and every random generator,
so that a resumed training does exactly what it would have done without a break, to the last bit.
"""

from __future__ import annotations

import random
from collections import deque
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.save_util import recursive_getattr
from stable_baselines3.common.vec_env import VecMonitor

from agents import snapshots
from agents.sb3.layers import layer_of, layers_of
from agents.sb3.vec_env import Sb3VecEnv

#: Counters and rates of stable-baselines3's algorithms that outlast a roll-out.
COUNTERS = ("num_timesteps", "_n_updates", "_episode_num", "_current_progress_remaining")

#: The columns of a replay buffer.
REPLAY = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


def state_of(model: Any) -> dict[str, Any]:
    """The state of a learning model in a `training_env`, between two roll-outs."""
    _, variables = model._get_torch_save_params()
    monitor = layer_of(model.env, VecMonitor)
    replay = getattr(model, "replay_buffer", None)
    return {
        "parameters": model.get_parameters(),
        "variables": {name: recursive_getattr(model, name) for name in variables},
        "counters": {name: getattr(model, name) for name in COUNTERS if hasattr(model, name)},
        "episodes": model.ep_info_buffer,
        "last_observations": model._last_obs,
        "last_starts": model._last_episode_starts,
        "replay": None if replay is None else _replay_of(replay),
        "environments": snapshots.state_of(layer_of(model.env, Sb3VecEnv).env),
        "layers": [layer.state() for layer in _with_state(model.env)],
        "monitored": {
            "returns": monitor.episode_returns.copy(),
            "lengths": monitor.episode_lengths.copy(),
        },
        "generators": {
            "torch": torch.get_rng_state(),
            "numpy": np.random.get_state(legacy=False),  # noqa: NPY002  stable-baselines3's
            "python": random.getstate(),
            "actions": model.action_space.np_random.bit_generator.state,
        },
    }


def begin_at(model: Any, observations: NDArray[np.float32]) -> None:
    """Let a model learn on in environments that someone else has stepped.

    Args:
        model: of stable-baselines3.
        observations: of its environments as they are now, (N, 6 or 8).
    """
    model._last_obs = observations
    model._last_episode_starts = np.ones(len(observations), dtype=bool)


def restore(model: Any, state: dict[str, Any]) -> None:
    """Put a new model, made with the same settings, into a state from `state_of`.

    It may raise anything if the state is from another kind of model, or is incomplete.
    """
    parameters = state["parameters"]
    if not isinstance(parameters, dict):  # stable-baselines3 would read a file of this name
        raise TypeError(f"its parameters are a {type(parameters).__name__}")
    if not set(state["counters"]) <= set(COUNTERS):
        raise ValueError(f"it has the counters {list(state['counters'])}")
    model.set_parameters(parameters, exact_match=True)
    for name, value in state["variables"].items():
        recursive_getattr(model, name).data.copy_(value)
    for name, value in state["counters"].items():
        setattr(model, name, value)
    # None, if it was saved before the first roll-out: while policies are screened.
    model.ep_info_buffer = deque(state["episodes"] or (), maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(maxlen=model._stats_window_size)
    model._last_obs = state["last_observations"]
    model._last_episode_starts = state["last_starts"]
    if state["replay"] is not None:
        _restore_replay(model.replay_buffer, state["replay"])
    monitor = layer_of(model.env, VecMonitor)
    monitor.episode_returns = state["monitored"]["returns"]
    monitor.episode_lengths = state["monitored"]["lengths"]
    for layer, own in zip(_with_state(model.env), state["layers"], strict=True):
        layer.restore(own)
    snapshots.restore(layer_of(model.env, Sb3VecEnv).env, state["environments"])
    _restore_generators(model, state["generators"])


def _with_state(env: Any) -> list[Any]:
    """The layers that later steps depend on; others would pass `state` on to what they enclose."""
    return [layer for layer in layers_of(env) if hasattr(type(layer), "state")]


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
