"""What the hyperparameters of stable-baselines3 may be, where it takes any and fails later."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rimless_gym.checks import integer, not_negative, positive, real

#: Arguments of stable-baselines3's algorithms that are no hyperparameters here. Those after the
#: first line are objects, need a state that a training does not keep, or change nothing learned.
NOT_OURS = (
    *("env", "seed", "device", "verbose", "tensorboard_log", "_init_setup_model"),
    *("use_sde", "sde_sample_freq", "use_sde_at_warmup", "action_noise", "optimize_memory_usage"),
    *("replay_buffer_class", "replay_buffer_kwargs", "rollout_buffer_class"),
    *("rollout_buffer_kwargs", "stats_window_size"),
)


def _share(name: str, value: Any) -> None:
    if not 0.0 <= real(name, value) <= 1.0:
        raise ValueError(f"{name} = {value}: must be at least 0 and at most 1")


def _one_or_more(name: str, value: Any) -> None:
    integer(name, value, 1)


def _as_many_as_collected(name: str, value: Any) -> None:
    if value != -1:  # as many as time steps were collected
        integer(name, value, 1)


def _frequency(name: str, value: Any) -> None:
    number, unit = value if isinstance(value, list | tuple) and len(value) == 2 else (value, "step")
    integer(name, number, 1)
    if unit not in ("step", "episode"):
        raise ValueError(f"{name} = {value!r}: count in 'step' or 'episode'")


def _entropy(name: str, value: Any) -> None:
    if isinstance(value, str):
        if value.partition("_")[0] != "auto":
            raise ValueError(f"{name} = {value!r}: write a number, auto, or auto_ and a number")
    else:
        not_negative(name, value)


#: How each of them is checked, by name.
BOUNDS: Mapping[str, Callable[[str, Any], Any]] = {
    **dict.fromkeys(("gamma", "gae_lambda", "tau"), _share),
    **dict.fromkeys(("max_grad_norm", "target_kl", "clip_range_vf"), positive),
    **dict.fromkeys(
        ("n_steps", "n_epochs", "batch_size", "buffer_size", "target_update_interval"), _one_or_more
    ),
    "gradient_steps": _as_many_as_collected,
    "train_freq": _frequency,
    "ent_coef": _entropy,
    "vf_coef": not_negative,
}


def require_possible(values: Mapping[str, Any]) -> None:
    """Refuse hyperparameters with which nothing can be learned.

    None stands for stable-baselines3's own choice.

    Raises:
        TypeError: one is of the wrong kind.
        ValueError: one is out of its range.
    """
    for name, value in values.items():
        if name in BOUNDS and value is not None:
            BOUNDS[name](name, value)
