"""The native vector environment: many single environments as rows, stepped together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from rimless_gym.checks import integer, real_array
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.envs.arguments import (
    DRAWN_START,
    Control,
    EpisodeStart,
    as_options,
    as_params_list,
    as_task,
    masked_rows,
    plain_spec,
    read_options,
    require_render_mode,
)
from rimless_gym.envs.batch import Batch, require_snapshot, restore
from rimless_gym.envs.disturbances import Disturbances, Ranges
from rimless_gym.envs.env import RimlessWheelEnv, completed
from rimless_gym.envs.interval import NO_LIMIT, take_actions
from rimless_gym.envs.layout import FLAG, MEMORY, RESULT, columns, dense_measurements, flags_of
from rimless_gym.envs.starts import Starts
from rimless_gym.envs.task import Task
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE, Machine

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Observations = NDArray[np.float32]
Seeds = int | Sequence[int | None] | NDArray[np.integer[Any]] | None

_PARTS = ("batch", "generators", "seen")  # of a snapshot


@completed
class RimlessWheelVectorEnv(VectorEnv[Observations, NDArray[np.float32], NDArray[Any]]):
    """Many actuated rimless wheels, stepped together by one compiled call.

    ## Description
    Row i is `RimlessWheelEnv`, bit for bit, and its page describes all that is the same. After
    `reset(seed=seed)`, its episodes are those of the single environment seeded with `seed + i`,
    whatever `num_envs` and `num_threads` are, and whatever the other rows do. Make it with
    `gym.make_vec("RimlessWheel-v0", num_envs=N, ...)`.

    ## Action, Observation, Rewards
    Actions are float32 (num_envs, 1), observations float32 (num_envs, 6), rewards float64
    (num_envs,). A NaN raises `ValueError` naming its row. Every call returns new arrays.

    ## Starting State
    `reset(seed=...)` takes a number (row i gets seed + i), a list or array with a number or None
    per row, or None.
    `reset(options=...)` takes the single environment's options, each for all rows or as a list
    with one per row (`starts`, `ranges` and `disturbances` for all rows only), and `reset_mask`, a
    bool array (num_envs,): only these rows are reset, and only their seeds and options count.

    ## Episode End
    Terminates like the single environment; truncates after `max_episode_steps`. What follows
    depends on `autoreset_mode`:

    - `NEXT_STEP` (default): the next `step` ignores the row's action and resets it, with reward 0
      and an `info` of zeros. (`info["elapsed"]` is also 0 where the new voltage or a push ends an
      episode at once; the row is then `terminated`.)
    - `SAME_STEP`: the row is reset at once; `info["final_obs"]` and `info["final_info"]` hold the
      last observation and info of the episode, for the rows marked in `info["_final_obs"]` and
      `info["_final_info"]`.
    - `DISABLED`: the caller resets with `reset_mask`; stepping an ended row raises.

    ## Arguments
    Those of the single environment, of which `params` may be a list of one per row, and

    - `num_envs`: N.
    - `max_episode_steps`: default 20 s of steps; None or -1 for no limit. `gym.make_vec` gives
      {steps} if you give nothing, which with a `control_period` longer than {period} s stands for
      20 s.
    - `autoreset_mode`: a `gymnasium.vector.AutoresetMode` or its value.
    - `num_threads`: threads that share a step; more than one is faster from a few thousand rows on.
    - `render_mode`: `"rgb_array"`: a tuple of frames, one per row, as Gymnasium's vector wrappers
      `RecordVideo` and `HumanRendering` take them.

    ## Info
    All of the single environment's `measurements` as arrays (num_envs,), new ones in every step.
    For a row whose episode ends in this step they describe that last step, except that `mode`
    belongs to the observed state.

    ## Version History
    - v0: first version, unreleased.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  as Gymnasium has it, and each environment its own
        "render_modes": ["rgb_array"],
        "render_fps": RimlessWheelEnv.metadata["render_fps"],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    default_task: ClassVar[Task] = RimlessWheelEnv.default_task
    default_period: ClassVar[float] = RimlessWheelEnv.default_period
    _speeds: tuple[float, float] | None = None
    closed = True  # until it is made: Gymnasium 1.2 closes an environment when it is deleted

    def __init__(
        self,
        num_envs: int = 1,
        params: Machine | Sequence[Machine] = BUILDABLE,
        task: Task | Mapping[str, float] | None = None,
        *,
        ranges: Ranges | Mapping[str, tuple[float, float]] | None = None,
        disturbances: Disturbances | Mapping[str, Any] | None = None,
        max_episode_steps: int | None = EPISODE_STEPS,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        num_threads: int = 1,
        render_mode: str | None = None,
        control_period: float = CONTROL_PERIOD,
        actions: str = "voltage",
        starts: Starts | Mapping[str, float] | None = None,
    ) -> None:
        require_render_mode(render_mode, self.metadata["render_modes"])
        num_envs = self.num_envs = integer("num_envs", num_envs, 1)
        num_threads = integer("num_threads", num_threads, 1)
        control = self.control = Control(control_period, actions, self._speeds)
        if max_episode_steps == -1:  # as in gym.make
            max_episode_steps = None
        if max_episode_steps is not None:
            max_episode_steps = integer("max_episode_steps", max_episode_steps, 1)
        usual = Control(self.default_period)
        if max_episode_steps == usual.episode_steps and control.period > usual.period:
            max_episode_steps = control.episode_steps
        self.render_mode = render_mode
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self.metadata["render_fps"] = round(1 / control.period)
        self.max_episode_steps = max_episode_steps
        self.single_action_space = control.action_space()
        self.single_observation_space = control.observation_space()
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        machines, task = as_params_list(params, num_envs), as_task(task, self.default_task)
        limit = min(max_episode_steps or NO_LIMIT, NO_LIMIT)
        self._batch = Batch(
            machines, task, ranges, disturbances, control, starts, num_threads, limit
        )
        self._seen = np.zeros((num_envs, control.width), dtype=np.float32)
        self._generators: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self.closed = False

    spec = plain_spec

    @property
    def params(self) -> tuple[WheelParams, ...]:
        """The machine of each row, as drawn if there are ranges."""
        return tuple(self._batch.params_of(i) for i in range(self.num_envs))

    @property
    def ranges(self) -> Ranges:
        """Ranges of the parameters that are drawn when an episode begins; empty if none is."""
        return self._batch.ranges

    @property
    def tasks(self) -> tuple[Task, ...]:
        """The weights of the reward in each row."""
        return tuple(self._batch.tasks)

    @property
    def observations(self) -> NDArray[np.float32]:
        """A copy of the latest observations (num_envs, 6), or (num_envs, 8) with a command."""
        return self._seen.copy()

    @property
    def states(self) -> Floats:
        """A copy of the hybrid states (num_envs, 6): phi, theta, phi', theta', mode, foot."""
        return self._batch.states

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generator of each row."""
        self._seed(None, np.arange(self.num_envs))
        return tuple(self._generators)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each row."""
        self._seed(None, np.arange(self.num_envs))
        return tuple(self._seeds)

    def reset(
        self,
        *,
        seed: Seeds = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Observations, dict[str, Any]]:
        """Start episodes; see "Starting State".

        Seeds and options are checked before anything changes.

        Returns:
            Observations and info of all rows; rows that are not reset keep their observations.
            Every entry of info is 0, except the modes.

        Raises:
            TypeError: a seed or option has the wrong type.
            ValueError: a seed or option is unknown or out of range.
            RuntimeError: no start was found, or a machine was drawn that cannot be stepped.
        """
        batch = self._batch
        options = as_options(options)
        rows = masked_rows(options.pop("reset_mask", None), self.num_envs)
        changes, start = read_options(options, batch, rows)
        self._seed(seed, rows)
        batch.change(rows, **changes)
        observations = self._seen.copy()
        self._begin(rows, observations, start)
        self._seen[:] = observations
        results = np.zeros((len(RESULT), self.num_envs))
        info: dict[str, Any] = dense_measurements(results, flags_of(results))
        info["mode"][:] = batch.memory[MEMORY.mode, : self.num_envs]
        return observations, info

    def step(self, actions: ArrayLike) -> tuple[Observations, Floats, Bools, Bools, dict[str, Any]]:
        """Hold the actions for a control period; the class docstring describes what is returned.

        Raises:
            TypeError: the actions are not real numbers.
            ValueError: an action is NaN, or their shape is not (num_envs, 1).
            RuntimeError: a row has ended and autoreset is disabled, or no episode has begun.
        """
        batch = self._batch
        again = batch.ended.nonzero()[0]
        if len(again) and (self.autoreset_mode is AutoresetMode.DISABLED or not batch.begun):
            raise RuntimeError(f"rows {again.tolist()} have no episode running: reset them first")
        self._take(actions, batch.ended)
        results = np.empty((len(RESULT), columns(self.num_envs)))
        observations = np.empty((self.num_envs, self.control.width), dtype=np.float32)
        unusual = batch.stepper(results, observations.reshape(-1))()
        results, flags = results[:, : self.num_envs], flags_of(results)[:, : self.num_envs]
        if len(again):
            results[: RESULT.flags, again] = 0.0
            flags[:, again] = 0
        terminated = flags[FLAG.terminated].view(np.bool_)
        truncated = flags[FLAG.truncated].view(np.bool_)
        info: dict[str, Any] = dense_measurements(results, flags)
        if unusual:
            ended = terminated | truncated
            batch.ended |= ended
            if self.autoreset_mode is AutoresetMode.SAME_STEP:
                info |= _final_info(ended, observations, results, flags)
                again = np.union1d(again, ended.nonzero()[0])
        if len(again):
            self._begin(again, observations)
            info["mode"][again] = batch.memory[MEMORY.mode, again]
        self._seen[:] = observations
        return observations, results[RESULT.reward], terminated, truncated, info

    def set_task(
        self, task: Task | Mapping[str, float], mask: NDArray[np.bool_] | None = None
    ) -> None:
        """Change the reward from the next step on, while the episodes go on.

        Args:
            task: as in the single environment; what a mapping leaves out stays as it is.
            mask: bool (num_envs,), as `reset_mask`: the rows whose reward changes.

        Raises:
            TypeError: it is neither a task nor a mapping, or the mask is not an array of bool.
            ValueError: a field is unknown or out of range, or the mask's shape is wrong.
        """
        rows = masked_rows(mask, self.num_envs, "mask")
        tasks = list(self.tasks)
        for i in rows.tolist():
            tasks[i] = as_task(task, tasks[i])
        self._batch.set_tasks(tasks, rows)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """The current frame (H, W, 3) of each row, in mode "rgb_array".

        Raises:
            RuntimeError: no episode has begun.
        """
        if self.render_mode is None:
            gym.logger.warn("render() without a render_mode: give one to gym.make_vec()")
            return None
        return tuple(self._batch.frame(i) for i in range(self.num_envs))

    def get_state(self) -> dict[str, Any]:
        """A snapshot. After `set_state` of it, everything goes on the same to the last bit.

        It can be pickled, and restored in another environment with as many rows, and the same
        control period and kind of action.
        """
        states = [generator.bit_generator.state for generator in self.np_random]
        batch = self._batch.get_state()
        return {"batch": batch, "generators": states, "seen": self._seen.copy()}

    def set_state(self, state: dict[str, Any]) -> None:
        """Go back to a snapshot from `get_state`, even one from before the first episodes.

        The snapshot is checked before anything changes.

        Raises:
            ValueError: it is not a snapshot of a vector environment with as many rows, and this
                control period and kind of action.
        """
        require_snapshot(state, _PARTS, self.num_envs, self.control, "RimlessWheelVectorEnv")
        restore(self.np_random, state["generators"])
        self._batch.set_state(state["batch"])
        self._seen[:] = state["seen"]

    def close_extras(self, **kwargs: Any) -> None:
        """Shut down the threads."""
        self._batch.close()

    def _begin(
        self, rows: NDArray[np.int64], observations: Observations, start: EpisodeStart = DRAWN_START
    ) -> None:
        draws = [self._generators[i].bit_generator.random_raw() for i in rows.tolist()]
        keys = np.array(draws, dtype=np.uint64)
        self._batch.begin(rows, keys, observations.reshape(-1), start)

    def _take(self, actions: ArrayLike, ignored: Bools) -> None:
        given = np.ascontiguousarray(actions)
        if given.dtype != np.float32:
            given = real_array("actions", given).astype(np.float64)
        if given.shape != (self.num_envs, 1):
            raise ValueError(f"actions: must have shape ({self.num_envs}, 1), not {given.shape}")
        if take_actions(given, ignored, self._batch.memory):
            wrong = np.isnan(given[:, 0]) & ~ignored
            raise ValueError(
                f"actions of rows {np.flatnonzero(wrong).tolist()} are NaN: must be numbers in "
                "[-1, 1]; check the policy's output"
            )

    def _seed(self, seed: Seeds, rows: NDArray[np.int64]) -> None:
        """Seed `rows` by one number, counted up over all rows, or by one number or None per row.

        A generator without a seed gets one from the system's entropy. Seeds are checked before
        anything changes.
        """
        seeds = _one_seed_per_row(seed, self.num_envs)
        chosen = np.arange(self.num_envs)
        if self._generators:
            chosen = np.array([i for i in rows if seeds[i] is not None], dtype=np.int64)
        else:
            self._generators = [np.random.default_rng(0)] * self.num_envs
            self._seeds = [0] * self.num_envs
        for i in chosen.tolist():
            self._generators[i], self._seeds[i] = seeding.np_random(seeds[i])


def _one_seed_per_row(seed: Any, n: int) -> list[int | None]:
    if seed is None:
        return [None] * n
    if np.ndim(seed) == 0:
        first = integer("seed", seed, 0)
        return [first + i for i in range(n)]
    if len(seed) != n:
        raise ValueError(f"seed: {len(seed)} seeds for {n} rows, must be one per row")
    return [None if each is None else integer("seed", each, 0) for each in seed]


def _final_info(
    ended: Bools, observations: Observations, results: Floats, flags: NDArray[np.int8]
) -> dict[str, Any]:
    """The last observations and info of the episodes that ended, in Gymnasium's form."""
    rows = ended.nonzero()[0]
    if not len(rows):
        return {}
    seen, last = np.zeros_like(observations), np.zeros(results.shape)
    seen[rows], last[: RESULT.flags, rows] = observations[rows], results[: RESULT.flags, rows]
    flags_of(last)[:, rows] = flags[:, rows]
    return {
        "final_obs": seen,
        "_final_obs": ended.copy(),
        "final_info": dense_measurements(last, flags_of(last)),
        "_final_info": ended.copy(),
    }
