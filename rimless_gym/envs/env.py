"""The Gymnasium environment."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import integer, real_array
from rimless_gym.energy import CHANNELS
from rimless_gym.envs.arguments import (
    Control,
    as_params_list,
    as_task,
    plain_spec,
    read_options,
    require_render_mode,
)
from rimless_gym.envs.batch import Batch, require_snapshot, restore
from rimless_gym.envs.disturbances import Disturbances, Ranges
from rimless_gym.envs.interval import NO_LIMIT
from rimless_gym.envs.layout import (
    FLAG,
    MEMORY,
    NO_INFO,
    RESULT,
    Flags,
    flags_of,
    measurements_of,
    step_result,
)
from rimless_gym.envs.starts import Starts
from rimless_gym.envs.task import TERM_NAMES, TERMS, USUAL_TASK, Task
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE, Machine, as_params
from rimless_gym.symbolic import HybridModel

T = TypeVar("T", bound=type[Any])

_ROW = np.zeros(1, dtype=np.int64)
_BOUND = ("_advance", "_action", "_results")  # to the batch's arrays
_PARTS = ("batch", "generators")  # of a snapshot


def completed(environment: T) -> T:
    """Put the terms of the reward and the energy balance into the class's docstring."""
    into, out_of = ([c.name for c in CHANNELS if c.sign == sign] for sign in (1, -1))
    terms = [
        f"- `{name}`: {' '.join((inspect.getdoc(term) or '').split())}"
        for name, term in zip(TERM_NAMES, TERMS, strict=True)
    ]
    usual = Control(environment.default_period)
    page = inspect.cleandoc(environment.__doc__ or "")  # Python 3.13 does so itself
    for name, text in {
        "task": repr(environment.default_task),
        "steps": str(usual.episode_steps),
        "period": f"{usual.period:g}",
        "balance": f"{' + '.join(into)} = {' + '.join(out_of)}",
        "terms": "\n".join(terms),
    }.items():
        page = page.replace(f"{{{name}}}", text)
    environment.__doc__ = page
    return environment


@completed
class RimlessWheelEnv(gym.Env[NDArray[np.float32], NDArray[np.float32]]):
    """An actuated rimless wheel that should walk far on little energy.

    ## Description
    A wheel of `n_legs` spokes and no rim walks on its spokes. A DC motor at the hub swings a
    pendulum; that swing is the only actuation. The wheel stands on one foot or two, every
    touchdown is a plastic impact, and the battery cannot be recharged. The model is that of
    Mihevc, *Dynamic Optimization of a Rimless Wheel with an Actuated Pendulum* (RIT, 2015),
    corrected and extended; `rimless_gym.equations` holds every equation.

    ## Action Space
    `Box(-1, 1, (1,), float32)`: motor voltage in units of `params.voltage_limit`, held for
    `control_period`; or motor current, see `actions`. Actions outside this range are clipped, and a
    plain number is accepted too. NaN and other shapes raise `ValueError`; anything but real numbers
    raises `TypeError`.

    ## Observation Space
    `Box` of 6 float32 numbers:

    | # | quantity | bound |
    |---|---|---|
    | 0 | leg angle (phi - pi/2) / (alpha/2), in the ground's frame | 1 |
    | 1 | sin theta, pendulum from the ground's normal | 1 |
    | 2 | cos theta | 1 |
    | 3 | phi' / (5 rad/s) | 12 |
    | 4 | theta' / (10 rad/s) | 6 |
    | 5 | 1 while resting on two feet, else 0 | 1 |

    ## Rewards
    In metres: `r = distance_weight * dx - E+ / ((m1+m2) g)`, less penalties for slipping and for an
    early end. A `target_speed` limits the travel dx that is rewarded. The weights are fields of
    `task`. The terms are in `info`; added from left to right in this order they give the reward to
    the last bit (Python's `sum` does not add so: since 3.12 it compensates rounding):

    {terms}

    Resting costs only idle power, `idle_power / ((m1+m2) g)` a second, and less than falling.

    The foot does not slip in the model: it holds, whatever friction that takes. So that no policy
    gains by what the ground would not bear, every interval in which the demand exceeds
    `params.friction` has a penalty. It does not end the episode, because most starts need more
    friction for a moment before they walk. A policy's evaluation is stricter: a walk that slips
    in its measured window does not count (`rimless_gym.rules`).

    Mean returns of 100 default episodes: random voltages -13, resting -0.3, an LQR 4.8, and
    the front's best gait 5.8 if it were walked for all 20 s. The registered
    `reward_threshold` is 4.5: what is left of the last for a walk that costs a quarter more and
    starts up as the LQR does from rest. docs/environment.md has the table.

    ## Starting State
    There are three kinds of start, each drawn uniformly from its ranges, and kept if the feet press
    on the ground:

    - `rest`: on two feet, theta within 0.5 rad of hanging and theta' within 1 rad/s;
    - `moving`: in single stance, phi in [a, b], theta in [-pi, pi], phi' in [0, 2] and theta' in
      [-3, 3] rad/s;
    - `whirling`: the same with 6 to 16 rad/s of theta', in either sense. Here it is enough that
      some voltage within the limit presses the foot on the ground.

    The shares of the three are the argument `starts`, by default 1/4, 3/4 and 0.
    `reset(options=...)` takes

    - `state`: phi, theta (within 1e5 rad), phi', theta'; and with it `mode`: "single_stance" (the
      default) or "double_stance", in which phi = a. `mode` "double_stance" without a `state` is a
      wheel at rest with the pendulum hanging.
    - `params`, `starts`, `ranges` and `disturbances`, as below. They hold until new ones are given;
      `{}` or None switches ranges or disturbances off.
    - `task`: a `rimless_gym.Task`, or a dictionary of the fields to change; it holds until another
      one is given.

    A state is accepted if some voltage within the limit presses the feet on the ground. In any
    other state, contact would be lost at once.

    ## Episode End
    Terminates where the model stops being valid: when the ground would have to pull a foot down
    (contact lost; the step ends at that moment), or when a rate exceeds 60 rad/s (checked a few
    times within a step and at its end). `info["failure"]` is the reason. If the new voltage or a
    push ends the episode at once, no time elapses in that step. Resting and whole turns of the
    pendulum are legal. A motion that cannot be followed ends too, with a reason of its own: one
    that diverges or touches down too often, or goes backward under the impact law "thesis".

    Truncates after 20 s. `gym.make` counts steps to do so, {steps} of them unless it is given
    `max_episode_steps`. With a `control_period` longer than {period} s, fewer steps make 20 s:
    `Control.episode_steps` of them, after which the environment itself truncates; there
    `max_episode_steps` can only shorten episodes.

    ## Arguments
    - `params`: the machine, default `BUILDABLE`: a `rimless_gym.WheelParams`, a preset's
      name such as `"PROTOTYPE"`, or a dictionary of the fields that differ from `BUILDABLE`'s.
    - `task`: a `rimless_gym.Task`, or a dictionary of some of its fields:
      `{task}`.
    - `render_mode`: `"rgb_array"` (needs no display) or `"human"`. With the first,
      `gymnasium.utils.play.play(env)` lets you drive the wheel with the arrow keys.
    - `ranges`: domain randomisation, a mapping such as `{"slope": (-0.02, 0.02)}` from fields of
      `params` to the least and greatest value. Each episode draws its machine uniformly from
      them; `env.unwrapped.params` is the machine drawn.
    - `disturbances`: a `rimless_gym.Disturbances` of `pushes=Pushes(rate, impulse)`,
      `sensor_noise=SensorNoise(leg_angle, pendulum_angle, leg_rate, pendulum_rate)`,
      `terrain=Terrain(slope_std)`, which is rough ground, and `actuator_delay`, in steps or a range
      of them; or dictionaries of their fields.
    - `starts`: a `rimless_gym.Starts(rest, moving, whirling)`, shares of which only the ratios
      count, or a dictionary of its fields.
    - `control_period`: the length of a step (s), a whole multiple of 10 ms up to 100 ms. The
      voltage is held for all of it, so that two steps of 10 ms at one voltage are one of 20 ms.
      Rewards and `info` are of a step, whatever its length.
    - `actions`: `"voltage"` (default), or `"current"`. Then the action is the motor's current at
      the beginning of the step, in units of `voltage_limit / armature_resistance`: the voltage
      held is this current's and the back-EMF's at that moment, as far as the limit allows.

    `env.spec` holds all of them as plain JSON values:
    `gym.make(EnvSpec.from_json(env.spec.to_json()))` makes the same environment again.

    ## Info
    For the step, each of the same type in every step:

    - `distance`: the hub's travel (m);
    - `electrical_positive` and `idle`: the energy drawn, without regeneration (J);
    - the terms of the reward;
    - `mode`: 0 on one foot, 1 on two;
    - `failure`: 0, or why the episode ended, a `rimless_gym.Failure`: 1 contact lost, 2 rate
      exceeded, and three that only unusual machines meet.

    `reset` gives the same entries, all 0 except the mode. `env.unwrapped.measurements` is a
    dictionary of these and of all else that was measured in the last step:

    - the terms of the energy ledger (J), which balance:
      `{balance}`;
      and outside the balance `electrical_positive`, `shaft` and `idle`.
      `rimless_gym.energy.CHANNELS` describes each;
    - `rewarded_travel`: the travel that is rewarded (m), which differs from `distance` only where
      the task has a `target_speed`;
    - `elapsed`: the step's duration (s); `steps` and `touchdowns`: net forward and total
      touchdowns; `touchdown_time`: the time of the last one since the step began (s), or -1;
    - `slips`: whether a force or an impulse needed more friction than `params.friction` offers,
      by more than a thousandth (in the model the foot holds all the same);
    - `force_x` and `force_y`: the ground reaction at the step's end (N); `min_normal_force`,
      `friction_demand` and `impulse_friction_demand`: the extremes. A wheel that touches down on a
      second foot and lifts the first at once never stood on both; such forces do not count;
    - `clearance`: the least height of the pendulum's end above the ground (m).

    ## Snapshots
    `get_state` and `set_state` save and restore everything, including the random generator, so that
    a planner can branch. Pickled and deep-copied environments continue in the same way.

    ## Vectorized environment
    `gym.make_vec("RimlessWheel-v0", num_envs=N)` makes a `rimless_gym.RimlessWheelVectorEnv`. Its
    rows are this environment bit for bit, stepped together.

    ## Version History
    - v0: first version, unreleased.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  as Gymnasium has it, and each environment its own
        "render_modes": ["human", "rgb_array"],
        "render_fps": round(1 / CONTROL_PERIOD),
    }
    default_task: ClassVar[Task] = USUAL_TASK
    default_period: ClassVar[float] = CONTROL_PERIOD  # to which the registered time limit belongs
    _speeds: tuple[float, float] | None = None  # between which one is commanded

    def __init__(
        self,
        params: Machine = BUILDABLE,
        task: Task | Mapping[str, float] | None = None,
        render_mode: str | None = None,
        *,
        ranges: Ranges | Mapping[str, tuple[float, float]] | None = None,
        disturbances: Disturbances | Mapping[str, Any] | None = None,
        control_period: float = CONTROL_PERIOD,
        actions: str = "voltage",
        starts: Starts | Mapping[str, float] | None = None,
    ) -> None:
        require_render_mode(render_mode, self.metadata["render_modes"])
        control = self.control = Control(control_period, actions, self._speeds)
        self.metadata = {**self.metadata, "render_fps": round(1 / control.period)}
        self.render_mode = render_mode
        self.action_space = control.action_space()
        self.observation_space = control.observation_space()
        longer = control.period > Control(self.default_period).period
        self.max_episode_steps = control.episode_steps if longer else None
        limit = self.max_episode_steps or NO_LIMIT
        machines, task = as_params_list(as_params(params), 1), as_task(task, self.default_task)
        self._batch = Batch(machines, task, ranges, disturbances, control, starts, limit=limit)
        self._buffer = np.zeros((len(RESULT), 1))
        self._observation = np.zeros(control.width, dtype=np.float32)
        self._ended = True
        self._watched = render_mode == "human"
        self._window: Any = None
        self._bind()

    spec = plain_spec

    @property
    def params(self) -> WheelParams:
        """The machine, as drawn if there are ranges."""
        return self._batch.params_of(0)

    @property
    def task(self) -> Task:
        """The weights of the reward."""
        return self._batch.tasks[0]

    def set_task(self, task: Task | Mapping[str, float]) -> None:
        """Change the reward from the next step on, while the episode goes on.

        Args:
            task: as in the constructor; what a mapping leaves out stays as it is.

        Raises:
            TypeError: it is neither a task nor a mapping.
            ValueError: a field is unknown or out of range.
        """
        self._batch.set_tasks([as_task(task, self.task)], np.arange(1))

    @cached_property
    def model(self) -> HybridModel:
        """The hybrid model as CasADi functions, for optimisation and model-based control."""
        return HybridModel(self.params)

    @property
    def state(self) -> NDArray[np.float64]:
        """A copy of the hybrid state: phi, theta, phi', theta', mode, foot."""
        self._batch.require_begun()
        return self._batch.states[0]

    @property
    def measurements(self) -> dict[str, Any]:
        """All that was measured in the last step; see "Info". After a reset, 0 except the mode."""
        measured = measurements_of(self._results.tobytes())
        return measured | {"mode": int(self._batch.memory[MEMORY.mode, 0])}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Start an episode; see "Starting State" for the options.

        Seed and options are checked before anything changes.

        Raises:
            TypeError: the seed or an option has the wrong type.
            ValueError: an option is unknown or a value out of range.
            RuntimeError: no start was found, or a machine was drawn that cannot be stepped.
        """
        batch = self._batch
        seed = None if seed is None else integer("seed", seed, 0)
        changes, start = read_options(options, batch, _ROW)
        super().reset(seed=seed)
        batch.change(_ROW, **changes)
        self._bind()
        if "params" in changes or batch.ranges.bounds:
            self.__dict__.pop("model", None)
        observation = np.empty(self.control.width, dtype=np.float32)
        key = np.array([self.np_random.bit_generator.random_raw()], dtype=np.uint64)
        self._ended = True
        batch.begin(_ROW, key, observation, start)
        self._ended = False
        self._buffer[:] = 0.0
        if self._watched:
            self.render()
        return observation, NO_INFO | {"mode": int(batch.memory[MEMORY.mode, 0])}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold a voltage for a control period; the class docstring describes what is returned.

        Raises:
            TypeError: the action is not a real number.
            ValueError: it is NaN or not of shape (1,) or ().
            RuntimeError: no episode is running.
        """
        if self._ended:
            raise RuntimeError("no episode is running: call reset() first")
        try:  # the usual array (1,) of floats, at least cost
            (number,) = action.tolist()
        except (AttributeError, TypeError, ValueError):
            number = None
        if number.__class__ is not float or number != number:
            number = _as_number(action)
        self._action[0] = number
        truncated = self._end() if self._advance() else False
        if self._watched:
            self.render()
        return step_result(self._results, self._observation.copy(), self._ended, truncated)

    def _end(self) -> bool:
        """End the episode if the motion failed; returns whether the time is up."""
        flags = Flags(*flags_of(self._buffer)[: len(FLAG), 0].tolist())
        self._ended = bool(flags.terminated)
        return bool(flags.truncated)

    def _bind(self) -> None:
        """Look up what `step` needs from the batch; call this after every change of the batch."""
        self._advance = self._batch.stepper(self._buffer, self._observation)
        self._action: Any = memoryview(self._batch.memory[MEMORY.action].data)
        self._results: Any = memoryview(self._buffer[:, 0].data)

    def render(self) -> NDArray[np.uint8] | None:
        """The current frame (H, W, 3) in mode "rgb_array"; drawn to a window in mode "human"."""
        if self.render_mode is None:
            gym.logger.warn("render() without a render_mode: give one to gym.make()")
            return None
        from rimless_gym.rendering.display import Window  # pygame only when it is needed

        frame = self._batch.frame(0)
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            self._window = Window((frame.shape[1], frame.shape[0]), self.metadata["render_fps"])
        self._window.show(frame)
        return None

    def get_keys_to_action(self) -> dict[tuple[int, ...], NDArray[np.float32]]:
        """The keys and their actions for `gymnasium.utils.play.play`.

        The left and right arrows give full negative and positive voltage, or half of it while the
        down arrow is held.
        """
        from rimless_gym.rendering.canvas import pygame  # only when it is needed

        keys: dict[tuple[int, ...], float] = {(pygame.K_LEFT,): -1.0, (pygame.K_RIGHT,): 1.0}
        keys |= {(pygame.K_DOWN, *key): volts / 2 for key, volts in keys.items()}
        return {key: np.array([volts], dtype=np.float32) for key, volts in keys.items()}

    def get_state(self) -> dict[str, Any]:
        """A snapshot. After `set_state` of it, everything goes on the same to the last bit.

        It can be pickled, and restored in another environment with the same control period and
        kind of action. A `TimeLimit` wrapper keeps its own count of steps.
        """
        self._batch.ended[0] = self._ended
        generator = self.np_random.bit_generator.state
        return {"batch": self._batch.get_state(), "generators": [generator]}

    def set_state(self, state: dict[str, Any]) -> None:
        """Go back to a snapshot from `get_state`, even one from before the first episode.

        The snapshot is checked before anything changes.

        Raises:
            ValueError: it is not a snapshot of a single environment with this control period and
                kind of action.
        """
        require_snapshot(state, _PARTS, 1, self.control, "RimlessWheelEnv")
        restore([self.np_random], state["generators"])
        self._batch.set_state(state["batch"])
        self._ended = bool(self._batch.ended[0])
        self._buffer[:] = 0.0
        self._bind()
        self.__dict__.pop("model", None)

    def __getstate__(self) -> dict[str, Any]:
        passing = ("model", "_window", *_BOUND)
        return {name: value for name, value in self.__dict__.items() if name not in passing}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state | {"_window": None}
        self._bind()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None


def _as_number(action: Any) -> float:
    """The number in an action that is not the usual array (1,) of floats."""
    array = real_array("action", action)
    if array.shape not in ((1,), ()):
        raise ValueError(f"action = {action!r}: must have shape (1,), not {array.shape}")
    number = float(array.item())
    if math.isnan(number):
        raise ValueError("action = NaN: must be a number in [-1, 1]; check the policy's output")
    return number
