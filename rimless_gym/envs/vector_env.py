"""The native vector environment: many single environments as rows, stepped together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from rimless_gym.checks import integer, real_array
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.envs import options as reset_options
from rimless_gym.envs.arguments import (
    as_task,
    fleet_of,
    machines_of,
    require_render_mode,
)
from rimless_gym.envs.control import Control
from rimless_gym.envs.disturbances import Disturbances, Ranges
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.envs.generators import Generators, Seeds
from rimless_gym.envs.info import dense_info, final_info
from rimless_gym.envs.interval import take_actions
from rimless_gym.envs.layout import BLOCK, MARK, MEMORY, columns
from rimless_gym.envs.layout import marks as marks_of
from rimless_gym.envs.orders import NO_LIMIT
from rimless_gym.envs.page import completed
from rimless_gym.envs.plain import plain_spec
from rimless_gym.envs.snapshots import require_snapshot
from rimless_gym.envs.start_shares import Starts
from rimless_gym.envs.starts import DRAWN
from rimless_gym.envs.task import Task
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import MODE
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE, Machine

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Observations = NDArray[np.float32]

_PARTS = ("fleet", "generators", "seen")  # of a snapshot
_NO_STATES = np.empty((0, MODE + 1))


@completed
class RimlessWheelVectorEnv(VectorEnv[Observations, NDArray[np.float32], NDArray[Any]]):
    """Many actuated rimless wheels, stepped together by one compiled call.

    ## Description
    Row i is `RimlessWheelEnv`, bit for bit. After `reset(seed=seed)`, its episodes are those of the
    single environment seeded with `seed + i`, whatever `num_envs` and `num_threads` are, and
    whatever the other rows do. Make it with `gym.make_vec("RimlessWheel-v0", num_envs=N, ...)`.

    ## Action Space
    `Box(-1, 1, (num_envs, 1), float32)`, as in the single environment; a NaN raises `ValueError`
    naming its row.

    ## Observation Space
    `Box` of shape (num_envs, 6), float32. Every call returns new arrays.

    ## Rewards
    Those of the single environment, float64 (num_envs,).

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

    A motion that leaves the model's range raises a `RuntimeError` that names the row. By then all
    rows have been stepped, and that row has ended.

    ## Arguments
    - `num_envs`: N.
    - `params`: the machine of all rows, or a list of one per row; each as in the single
      environment.
    - `task`: as in the single environment.
    - `max_episode_steps`: default 20 s of steps; None for no limit. `gym.make_vec` gives {steps}
      if you give nothing, which with a `control_period` longer than {period} s stands for 20 s.
    - `autoreset_mode`: a `gymnasium.vector.AutoresetMode` or its value.
    - `num_threads`: threads that share a step; more than one pays from a few thousand rows on.
    - `render_mode`: `"rgb_array"`: a tuple of frames, one per row, as Gymnasium's vector wrappers
      `RecordVideo` and `HumanRendering` take them.
    - `ranges`, `disturbances`: as in the single environment; each row draws its own.
    - `control_period`, `actions`, `starts`: as in the single environment.

    `gym.make_vec(EnvSpec.from_json(envs.spec.to_json()))` makes the same environments again.

    ## Info
    The single environment's entries as arrays (num_envs,), new ones in every step. For
    a row whose episode ends in this step they describe that last step, except that `mode` belongs
    to the observed state.

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
        machines = machines_of(params, num_envs)
        limit = min(max_episode_steps or NO_LIMIT, NO_LIMIT)
        self._fleet = fleet_of(
            machines,
            as_task(task, self.default_task),
            ranges,
            disturbances,
            control,
            starts,
            num_threads,
            limit,
        )
        self._seen = np.zeros((num_envs, self.control.width), dtype=np.float32)
        self._generators = Generators(num_envs)
        self.closed = False

    spec = plain_spec

    @property
    def params(self) -> tuple[WheelParams, ...]:
        """The machine of each row, as drawn if there are ranges."""
        return tuple(self._fleet.machine(i) for i in range(self.num_envs))

    @property
    def ranges(self) -> Ranges:
        """Ranges of the parameters that are drawn when an episode begins; empty if none is."""
        return self._fleet.ranges

    @property
    def tasks(self) -> tuple[Task, ...]:
        """What is paid for in each row."""
        return tuple(self._fleet.tasks)

    @property
    def states(self) -> Floats:
        """A copy of the hybrid states (num_envs, 6): phi, theta, phi', theta', mode, foot."""
        return self._fleet.states

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generator of each row."""
        self._generators.seed(None, np.arange(self.num_envs))
        return tuple(self._generators.each)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seed of each row."""
        self._generators.seed(None, np.arange(self.num_envs))
        return tuple(self._generators.seeds)

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
        fleet = self._fleet
        options = dict(options or {})
        rows = reset_options.masked(options.pop("reset_mask", None), self.num_envs)
        chosen = reset_options.read(options, fleet, rows)
        self._generators.seed(seed, rows)
        chosen.apply(fleet)
        observations = self._seen.copy()
        self._begin(rows, observations, chosen.kind, chosen.given, chosen.speeds)
        self._seen[:] = observations
        block = np.zeros((len(BLOCK), self.num_envs))
        info = dense_info(block, marks_of(block))
        info["mode"][:] = fleet.memory[MEMORY.mode, : self.num_envs]
        return observations, info

    def step(self, actions: ArrayLike) -> tuple[Observations, Floats, Bools, Bools, dict[str, Any]]:
        """Hold the actions for a control period; the class docstring describes what is returned.

        Raises:
            TypeError: the actions are not real numbers.
            ValueError: an action is NaN, or their shape is not (num_envs, 1).
            RuntimeError: a row has ended and autoreset is disabled, or no episode has begun, or a
                motion left the model's range.
        """
        fleet = self._fleet
        again = fleet.ended.nonzero()[0]
        if len(again) and (self.autoreset_mode is AutoresetMode.DISABLED or not fleet.begun):
            raise RuntimeError(f"rows {again.tolist()} have no episode running: reset them first")
        self._take(actions, fleet.ended)
        block = np.empty((len(BLOCK), columns(self.num_envs)))
        observations = np.empty((self.num_envs, self.control.width), dtype=np.float32)
        unusual = fleet.stepper(block, observations.reshape(-1))()
        block, marks = block[:, : self.num_envs], marks_of(block)[:, : self.num_envs]
        if len(again):
            block[: BLOCK.marks, again] = 0.0
            marks[:, again] = 0
        terminated = marks[MARK.terminated].view(np.bool_)
        truncated = marks[MARK.truncated].view(np.bool_)
        info = dense_info(block, marks)
        if unusual:
            ended = terminated | truncated
            fleet.ended |= ended
            self._require_range(marks)
            if self.autoreset_mode is AutoresetMode.SAME_STEP:
                info |= final_info(ended, observations, block, marks)
                again = np.union1d(again, ended.nonzero()[0])
        if len(again):
            self._begin(again, observations, DRAWN, _NO_STATES)
            info["mode"][again] = fleet.memory[MEMORY.mode, again]
        self._seen[:] = observations
        return observations, block[BLOCK.reward], terminated, truncated, info

    def set_task(
        self, task: Task | Mapping[str, float], mask: NDArray[np.bool_] | None = None
    ) -> None:
        """Pay by other prices from the next step on, while the episodes go on.

        Args:
            task: as in the single environment; what a mapping leaves out stays as it is.
            mask: bool (num_envs,), as `reset_mask`: the rows that pay so.

        Raises:
            TypeError: it is neither a task nor a mapping, or the mask is not an array of bool.
            ValueError: a field is unknown or out of range, or the mask's shape is wrong.
        """
        rows = reset_options.masked(mask, self.num_envs, "mask")
        tasks = list(self.tasks)
        for i in rows.tolist():
            tasks[i] = as_task(task, tasks[i])
        self._fleet.set_tasks(tasks, rows)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """The current frame (H, W, 3) of each row, in mode "rgb_array".

        Raises:
            RuntimeError: no episode has begun.
        """
        if self.render_mode is None:
            gym.logger.warn("render() without a render_mode: give one to gym.make_vec()")
            return None
        from rimless_gym.envs.views import frame_of  # pygame only when it is needed

        if not self._fleet.begun:
            raise RuntimeError("no episode has begun: call reset() first")
        return tuple(frame_of(self._fleet, i) for i in range(self.num_envs))

    def get_state(self) -> dict[str, Any]:
        """A snapshot. After `set_state` of it, everything goes on the same to the last bit.

        It can be pickled, and restored in another environment with as many rows, and the same
        control period and kind of action.
        """
        return {
            "fleet": self._fleet.get_state(),
            "generators": self._generators.get_state(),
            "seen": self._seen.copy(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Go back to a snapshot from `get_state`, even one from before the first episodes.

        The snapshot is checked before anything changes.

        Raises:
            TypeError: it is not a snapshot.
            ValueError: it is from a single environment, or its number of rows, control
                period or kind of action differs.
        """
        require_snapshot(state, _PARTS, self.num_envs, self.control, "RimlessWheelVectorEnv")
        self._generators.set_state(state["generators"])
        self._fleet.set_state(state["fleet"])
        self._seen[:] = state["seen"]

    def close_extras(self, **kwargs: Any) -> None:
        """Shut down the threads."""
        self._fleet.close()

    def _begin(
        self,
        rows: NDArray[np.int64],
        observations: Observations,
        kind: int,
        given: Floats,
        speeds: Floats | None = None,
    ) -> None:
        keys = self._generators.keys(rows)
        self._fleet.begin(rows, keys, kind, given, observations.reshape(-1), speeds)

    def _take(self, actions: ArrayLike, ignored: Bools) -> None:
        given = np.ascontiguousarray(actions)
        if given.dtype != np.float32:
            given = real_array("actions", given).astype(np.float64)
        if given.shape != (self.num_envs, 1):
            raise ValueError(f"actions: must have shape ({self.num_envs}, 1), not {given.shape}")
        if take_actions(given, ignored, self._fleet.memory):
            wrong = np.isnan(given[:, 0]) & ~ignored
            raise ValueError(
                f"actions of rows {np.flatnonzero(wrong).tolist()} are NaN: must be numbers in "
                "[-1, 1]; check the policy's output"
            )

    def _require_range(self, marks: NDArray[np.int8]) -> None:
        lost = np.flatnonzero((marks[MARK.failure] != 0) & (marks[MARK.terminated] == 0))
        if len(lost):
            self._fleet.ended[lost] = True
            raise self._fleet.range_left(int(lost[0]), int(marks[MARK.failure, lost[0]]))
