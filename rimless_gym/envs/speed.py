"""Walking at a commanded speed on little energy: the environments with a command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from rimless_gym.envs.arguments import as_speeds, masked_rows
from rimless_gym.envs.batch import Batch
from rimless_gym.envs.env import RimlessWheelEnv, completed
from rimless_gym.envs.layout import MEMORY
from rimless_gym.envs.task import Task
from rimless_gym.envs.vector_env import RimlessWheelVectorEnv
from rimless_gym.presets import BUILDABLE, Machine

#: Between these, commands are drawn (m/s): from the slowest steady walks to fast ones.
SPEEDS = (0.3, 0.62)

#: Length of a step (s); noise that changes faster moves the pendulum too little to learn from.
PERIOD = 0.04

#: The weight of distance is more than what a first clumsy walk costs, about 1: with a lower one,
#: standing still is the optimum of every policy that has not learned yet. The penalty for a fall is
#: low, so that policies explore.
TASK = Task(distance_weight=5.0, fall_penalty=0.5, slip_penalty=1.0)


@completed
class RimlessWheelSpeedEnv(RimlessWheelEnv):
    """An actuated rimless wheel that should walk at a commanded speed on little energy.

    ## Description
    `gym.make("RimlessWheelSpeed-v0")` makes the machine and the ground of `RimlessWheelEnv`, whose
    page describes all that is the same. What differs: a speed is commanded and observed, distance
    is rewarded up to that speed, and a step takes 40 ms.

    ## Action Space
    `Box(-1, 1, (1,), float32)`: motor voltage in units of `params.voltage_limit`, held for 40 ms.

    ## Observation Space
    `Box` of 8 float32 numbers: the six of `RimlessWheelEnv`, and

    | # | quantity | bound |
    |---|---|---|
    | 6 | (commanded speed - 0.45 m/s) / (0.2 m/s) | 7.75 |
    | 7 | allowance: the travel that may still be rewarded, in step lengths | 1 |

    Sensor noise does not change these two.

    ## Rewards
    In metres: `r = distance_weight * rewarded_travel - E+ / ((m1+m2) g)`, less penalties for
    slipping and for an early end.

    {terms}

    `rewarded_travel` is the hub's travel, but never more than the allowance. The allowance is one
    step length when an episode begins. Travel uses it up, and it grows at the commanded speed, up
    to one step length again. So going faster than commanded is not rewarded, while a walk may vary
    its speed within a step. Distance weighs more than it costs: the optimum is the most efficient
    walk at the commanded speed.

    The default weights are `{task}`.
    They have been chosen for learning, not for a battery: with the weight of `RimlessWheel-v0`,
    0.5, standing still is the optimum of every policy that has not learned yet.

    The front would return 48 m on average if it were walked at the commanded speed for all 20 s.
    The registered `reward_threshold` is 45, about what is left of it for a walk that costs a
    quarter more and starts up as the policy `front` does from rest.

    ## Starting State
    As in `RimlessWheelEnv`. The command is drawn uniformly from `speeds`. `reset(options=...)` also
    takes `speed` (m/s), the command for this one episode.

    ## Episode End
    As in `RimlessWheelEnv`. Truncates after 20 s, {steps} steps of {period} s. With a
    `control_period` longer than that, the environment itself truncates after 20 s; with a shorter
    one, give `gym.make` the `max_episode_steps` that you want.

    ## Arguments
    Those of `RimlessWheelEnv`, with a `control_period` of {period} s by default, and

    - `speeds`: the least and the greatest speed that is commanded (m/s), by default (0.3, 0.62);
      more than 0 and at most 2.

    The command takes the place of the `target_speed` of `task`, which is refused here. A `Task`
    given as such has the defaults of `RimlessWheel-v0`; a dictionary changes those of this
    environment.

    ## Changes of command
    `env.unwrapped.set_command(speed)` changes the command within an episode. The reward follows at
    once, and the next observation has it. `env.unwrapped.command` is the present one (m/s).

    ## Info
    That of `RimlessWheelEnv`.

    ## Vectorized environment
    `gym.make_vec("RimlessWheelSpeed-v0", num_envs=N)` makes a
    `rimless_gym.RimlessWheelSpeedVectorEnv`. Its rows are this environment bit for bit.

    ## Version History
    - v0: first version, unreleased.
    """

    default_task: ClassVar[Task] = TASK
    default_period: ClassVar[float] = PERIOD

    def __init__(
        self,
        params: Machine = BUILDABLE,
        task: Task | Mapping[str, float] | None = None,
        render_mode: str | None = None,
        *,
        speeds: tuple[float, float] = SPEEDS,
        control_period: float = PERIOD,
        **arguments: Any,
    ) -> None:
        self._speeds = _range(speeds)
        super().__init__(params, task, render_mode, control_period=control_period, **arguments)

    @property
    def command(self) -> float:
        """The commanded speed (m/s); 0 before the first episode."""
        return float(self._batch.commands[0])

    def set_command(self, speed: float) -> None:
        """Command another speed (m/s) for the rest of the episode.

        Raises:
            TypeError: the speed is not a real number.
            ValueError: it is not greater than 0, or more than 2.
            RuntimeError: no episode has begun.
        """
        _command(self._batch, speed, np.arange(1))


@completed
class RimlessWheelSpeedVectorEnv(RimlessWheelVectorEnv):
    """Many rimless wheels, each with its own commanded speed, stepped together.

    Row i is `RimlessWheelSpeedEnv`, bit for bit; in every other respect this is
    `RimlessWheelVectorEnv`: see their pages. Observations have shape (num_envs, 8).
    `reset(options={"speed": ...})` takes one speed for all rows or one for each, and
    `set_command(speed, mask)` changes the commands of some rows within their episodes. The command
    that a row draws after an autoreset comes from `speeds` again.

    `max_episode_steps` is by default 20 s of steps, {steps} of {period} s.
    """

    default_task: ClassVar[Task] = TASK
    default_period: ClassVar[float] = PERIOD

    def __init__(
        self,
        num_envs: int = 1,
        params: Machine | Sequence[Machine] = BUILDABLE,
        task: Task | Mapping[str, float] | None = None,
        *,
        speeds: tuple[float, float] = SPEEDS,
        control_period: float = PERIOD,
        **arguments: Any,
    ) -> None:
        self._speeds = _range(speeds)
        super().__init__(num_envs, params, task, control_period=control_period, **arguments)

    @property
    def commands(self) -> NDArray[np.float64]:
        """The commanded speed of each row (m/s), (num_envs,); 0 before the first episode."""
        return self._batch.commands

    def set_command(self, speed: Any, mask: NDArray[np.bool_] | None = None) -> None:
        """Command another speed for the rest of the episodes, in all rows or those of a mask.

        Args:
            speed: the speed (m/s), one for all of these rows or one for each.
            mask: bool (num_envs,), as `reset_mask`.

        Raises:
            TypeError: the speed is not a real number, or the mask is not an array of bool.
            ValueError: a speed is not greater than 0, or more than 2, or a shape is wrong.
            RuntimeError: no episode has begun.
        """
        _command(self._batch, speed, masked_rows(mask, self.num_envs, "mask"))


def _range(speeds: Any) -> tuple[float, float]:
    if speeds is None:
        raise TypeError("speeds = None: give the least and the greatest speed (m/s)")
    return speeds


def _command(batch: Batch, speed: Any, rows: NDArray[np.int64]) -> None:
    speeds = as_speeds("speed", speed, len(rows))
    batch.require_begun()
    batch.memory[MEMORY.target_speed, rows] = speeds
