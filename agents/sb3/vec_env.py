"""The native vector environment as stable-baselines3's `VecEnv`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit
from numpy.typing import NDArray
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from agents.prior import WithPrior
from rimless_gym import (
    RimlessWheelSpeedEnv,
    RimlessWheelSpeedVectorEnv,
    RimlessWheelVectorEnv,
)
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.envs.layout import NO_INFO, info_of_row

#: The native environment of each single one.
NATIVE: dict[type, type[RimlessWheelVectorEnv]] = {
    RimlessWheelEnv: RimlessWheelVectorEnv,
    RimlessWheelSpeedEnv: RimlessWheelSpeedVectorEnv,
}

#: Wrappers whose effect `Sb3VecEnv` reproduces.
HONOURED = (Monitor, TimeLimit, OrderEnforcing, PassiveEnvChecker)

_FINAL = ("final_obs", "_final_obs", "final_info", "_final_info")

#: What the native environment calls the attributes of a single one.
_NATIVE_NAMES = {
    "action_space": "single_action_space",
    "observation_space": "single_observation_space",
    "state": "states",
    "task": "tasks",
    "command": "commands",
}


class Sb3VecEnv(VecEnv):
    """Many wheels for stable-baselines3, stepped together by one compiled call.

    Gives what `DummyVecEnv` gives with as many single environments, bit for bit: observations
    (N, 6) float32 or with a commanded speed (N, 8), rewards (N,) float32, dones (N,), and a list of
    N dictionaries. Those of rows that go on hold only `TimeLimit.truncated`; `last_info` has the
    measurements of all rows as arrays. At the end of an episode they hold the single environment's
    `info`, `terminal_observation`, a copy, and `episode` where the environments are monitored.

    Either of::

        Sb3VecEnv(gym.make_vec("RimlessWheel-v0", num_envs=64, autoreset_mode="SameStep"))
        make_vec_env("RimlessWheel-v0", n_envs=64, vec_env_cls=Sb3VecEnv)

    with `RimlessWheelSpeed-v0` too. The first counts no episodes: put a `VecMonitor` around it.
    `set_options` takes the options of the environment's next reset, for all rows or one for each;
    `params` is one of them.

    Args:
        envs: a native vector environment that resets in the same step, perhaps with the wrappers
            of `agents.prior`; or functions that make single environments, as for
            stable-baselines3's own classes. Native rows take their place. They may have different
            `params`. Time limits and Monitors, files included, keep their effect; other wrappers
            are refused.

    Attributes:
        env: the native vector environment, perhaps with the wrappers of `agents.prior`.
        native: the same without them.
        last_info: its `info` of the last step: the measurements as arrays (N,), those of rows that
            ended in it included.

    Raises:
        TypeError: `envs` is neither, or not of rimless wheels.
        ValueError: the rows reset themselves at another time, or there are wrappers whose effect
            cannot be reproduced.
    """

    def __init__(
        self, envs: VectorEnv[Any, Any, Any] | Sequence[Callable[[], gym.Env[Any, Any]]]
    ) -> None:
        singles: list[gym.Env[Any, Any]] = []
        if isinstance(envs, VectorEnv):
            self.env = _same_step(envs)
        else:
            singles = [make() for make in envs]
            self.env = _gathered(singles)
        native = self.native = self.env.unwrapped
        self._wrappers = [list(_wrappers_of(single)) for single in singles] or [
            []
        ] * native.num_envs
        self._monitors = [
            [wrapper for wrapper in row if isinstance(wrapper, Monitor)] for row in self._wrappers
        ]
        self._returns = np.zeros(native.num_envs)
        self._lengths = np.zeros(native.num_envs, dtype=np.int64)
        self._actions = np.zeros((native.num_envs, 1), dtype=np.float32)
        self.last_info: dict[str, NDArray[Any]] = {}
        super().__init__(
            native.num_envs, native.single_observation_space, native.single_action_space
        )
        self.metadata = native.metadata
        self.spec = singles[0].spec if singles else native.spec

    def reset(self) -> NDArray[np.float32]:
        """Begin episodes with the seeds and options given before; they are used once.

        Raises:
            ValueError: an option is unknown or its value out of range.
        """
        if len(self._options) != self.num_envs:
            raise ValueError(f"{len(self._options)} options for {self.num_envs} rows: one for each")
        alike: dict[int, list[int]] = {}
        for i, options in enumerate(self._options):
            alike.setdefault(id(options) if options else 0, []).append(i)
        for rows in alike.values():
            options = self._options[rows[0]]
            mask = np.isin(np.arange(self.num_envs), rows)
            observations, columns = self.env.reset(
                seed=self._seeds, options={**options, "reset_mask": mask}
            )
        self.reset_infos = [info_of_row(columns, i) for i in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        self._returns[:], self._lengths[:] = 0.0, 0
        return observations

    def step_async(self, actions: NDArray[np.float32]) -> None:
        """Keep the actions (N, 1) for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Hold the actions for a control period; rows that ended have begun their next episode.

        Raises:
            ValueError: an action is NaN, or their shape is not (N, 1).
        """
        observations, rewards, terminated, truncated, columns = self.env.step(self._actions)
        final = {name: columns.pop(name) for name in _FINAL if name in columns}
        self.last_info = columns
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": False} for _ in range(self.num_envs)]
        self._returns += rewards
        self._lengths += 1
        dones = terminated | truncated
        if final:
            last = {name: final["final_info"][name] for name in columns}
            for i in dones.nonzero()[0].tolist():
                info = info_of_row(last, i)
                info["TimeLimit.truncated"] = not terminated[i]
                info["terminal_observation"] = final["final_obs"][i].copy()
                self._end_episode(i, info)
                self.reset_infos[i] = NO_INFO | {"mode": columns["mode"].item(i)}
                infos[i] = info
        return observations, rewards.astype(np.float32), dones, infos

    def _end_episode(self, i: int, info: dict[str, Any]) -> None:
        """Do what the Monitors of row i do when an episode ends."""
        for monitor in self._monitors[i]:
            total, length = float(self._returns[i]), int(self._lengths[i])
            elapsed = time.time() - monitor.t_start
            episode = {"r": round(total, 6), "l": length, "t": round(elapsed, 6)}
            episode |= {name: info[name] for name in monitor.info_keywords}
            if monitor.results_writer is not None:
                monitor.results_writer.write_row(episode)
            info["episode"] = episode
        self._returns[i], self._lengths[i] = 0.0, 0

    def close(self) -> None:
        """Close the native environment and the Monitors' files."""
        self.env.close()
        for row in self._wrappers:
            for wrapper in row[:1]:
                wrapper.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """A frame (H, W, 3) of each row: render_mode "rgb_array"."""
        frames = self.env.render() if self.render_mode else None
        return frames or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """The attribute of each row, by the name that it has in a single environment.

        Raises:
            AttributeError: there is none.
        """
        value = getattr(self.native, _NATIVE_NAMES.get(attr_name, attr_name))
        each = isinstance(value, (tuple, np.ndarray)) and len(value) == self.num_envs
        return [value[i] if each else value for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Refused: a row has no attributes of its own."""
        raise NotImplementedError("rows share one environment; use set_options")

    def env_method(
        self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any
    ) -> list[Any]:
        """Call `get_wrapper_attr`; a row has no other method of its own."""
        if method_name == "get_wrapper_attr":
            return self.get_attr(args[0], indices)
        raise NotImplementedError(
            f"env_method({method_name!r}): native rows share one environment; see the methods of "
            "Sb3VecEnv.env"
        )

    def env_is_wrapped(
        self, wrapper_class: type[gym.Wrapper[Any, Any, Any, Any]], indices: VecEnvIndices = None
    ) -> list[bool]:
        """Whether each row stands for an environment in such a wrapper."""
        return [
            any(isinstance(wrapper, wrapper_class) for wrapper in self._wrappers[i])
            for i in self._get_indices(indices)
        ]


def _same_step(env: Any) -> Any:
    """The environment, if its rows are native and reset in the step that ends an episode."""
    native = env
    while isinstance(native, WithPrior):
        native = native.env
    if not isinstance(native, RimlessWheelVectorEnv):
        raise TypeError(
            f"{env}: must be the native environment, gym.make_vec('RimlessWheel-v0', ...), without "
            "wrappers; use stable-baselines3's (VecMonitor, VecNormalize, ...) around this one"
        )
    if native.autoreset_mode is not AutoresetMode.SAME_STEP:
        raise ValueError(
            f"autoreset_mode = {native.autoreset_mode}: stable-baselines3 wants the next episode's "
            "first observation from the step that ended the last; make it with "
            "gym.make_vec(..., autoreset_mode=AutoresetMode.SAME_STEP)"
        )
    return env


def _wrappers_of(env: gym.Env[Any, Any]) -> Iterator[gym.Wrapper[Any, Any, Any, Any]]:
    """The wrappers around an environment, from the outside in."""
    while isinstance(env, gym.Wrapper):
        yield env
        env = env.env


def _gathered(envs: Sequence[gym.Env[Any, Any]]) -> RimlessWheelVectorEnv:
    """Rows that behave like the single environments, with autoreset in the same step."""
    arguments = [_arguments_of(env) for env in envs]
    shared = {name: value for name, value in arguments[0].items() if name != "params"}
    for i, other in enumerate(arguments):
        for name, value in shared.items():
            if other[name] != value:
                raise ValueError(
                    f"environment {i} has {name} = {other[name]}, the first {value}: they may "
                    "differ in params only; use DummyVecEnv for others"
                )
    native = shared.pop("native")
    return native(
        num_envs=len(envs),
        params=[each["params"] for each in arguments],
        autoreset_mode=AutoresetMode.SAME_STEP,
        **shared,
    )


def _arguments_of(env: gym.Env[Any, Any]) -> dict[str, Any]:
    """The arguments with which the native environment behaves like this one."""
    single: Any = env.unwrapped
    limits = []
    if type(single) not in NATIVE:
        names = " or a ".join(kind.__name__ for kind in NATIVE)
        raise TypeError(
            f"{single}: must be a {names}, whose rows are stepped natively; use DummyVecEnv for "
            "others"
        )
    for wrapper in _wrappers_of(env):
        if type(wrapper) not in HONOURED:
            name = type(wrapper).__name__
            raise ValueError(
                f"wrapper {name}: native rows cannot be wrapped one by one; put a VecEnvWrapper "
                f"that does the same around the vector, or use DummyVecEnv with {name}"
            )
        if isinstance(wrapper, TimeLimit):
            limits.append(wrapper._max_episode_steps)
    if single.max_episode_steps is not None:
        limits.append(single.max_episode_steps)
    batch = single.get_state()["batch"]  # the parameters before anything was drawn
    commanded = {} if single.control.speeds is None else {"speeds": single.control.speeds}
    return {
        "native": NATIVE[type(single)],
        "params": batch["params"][0],
        "task": single.task,
        "ranges": batch["ranges"],
        "disturbances": batch["disturbances"],
        "starts": batch["starts"],
        "control_period": single.control.period,
        "actions": single.control.actions,
        "max_episode_steps": min(limits, default=None),
        "render_mode": single.render_mode,
        **commanded,
    }
