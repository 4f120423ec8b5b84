"""The walking task in JAX, with the interface of gymnax 1.x."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from rimless_gym import params as machines
from rimless_gym import rules, streams
from rimless_gym.envs import EPISODE_STEPS, layout, starts, task
from rimless_gym.envs.arguments import Control
from rimless_gym.envs.disturbances import Ranges
from rimless_gym.envs.starts import USUAL_STARTS, Starts
from rimless_gym.envs.task import USUAL_TASK, Task
from rimless_gym.hybrid import CONTROL_PERIOD, OK
from rimless_gym.jax.interval import NUMERICS, Machine, Totals, advance
from rimless_gym.jax.traced import OF_ARRAYS, traced
from rimless_gym.kernel.stepping import HybridState, require_steppable
from rimless_gym.params import Constants
from rimless_gym.presets import BUILDABLE, as_params
from rimless_gym.presets import Machine as GivenMachine
from rimless_gym.tracing import joined

#: The functions of the task, of JAX's arrays. A stream is an iterator over random numbers.
_task = joined(
    {
        machines: (
            *("weight_of", "leg_angle_of", "step_length_of", "reach_of", "rod_reach"),
            "constants_of",
        ),
        layout: ("observation", "observed_command", "_within"),
        rules: ("exceeds",),
        starts: ("draw_state", "greatest_force"),
        streams: ("between",),
        task: ("rewarded", *(term.__name__ for term in task.TERMS)),
    },
    jnp.where,
    **OF_ARRAYS,
    hybrid=traced,
    next_uniform=lambda streams, i: next(streams),
    DRAWS=1,
)

DRAWN = 9  # random numbers for a start, at most


class EnvParams(NamedTuple):
    """What gymnax calls the parameters of an environment."""

    max_steps_in_episode: int = EPISODE_STEPS


class EnvState(NamedTuple):
    """A row's state.

    Attributes:
        wheel: the hybrid state; theta is between -pi and pi.
        time: control intervals since the episode began.
        allowance: travel that may still be rewarded (m); see `rimless_gym.envs.task.Task`.
        target_speed: the commanded speed (m/s), or infinity.
        drawn: the parameters of the machine that are drawn for each episode, by name.
    """

    wheel: HybridState
    time: Any
    allowance: Any
    target_speed: Any
    drawn: Mapping[str, Any]


class Box(NamedTuple):
    """A space of arrays."""

    low: Any
    high: Any
    shape: tuple[int, ...]
    dtype: Any

    def sample(self, key: Any) -> Any:
        """A uniformly distributed element."""
        return jax.random.uniform(key, self.shape, self.dtype, self.low, self.high)


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class WheelEnv:
    """An actuated rimless wheel; `RimlessWheelEnv` describes task, observation and action.

    All methods are of one row; use `jax.vmap`. In float32, the states of a walk are accurate to
    about 1e-5 an interval; in float64 they are the compiled simulator's, to about 1e-12.
    A row that stays behind holds up the rows beside it.

    Args:
        params: the machine.
        task: weight and penalties; its target speed is drawn if there are `speeds`.
        starts: shares of the kinds of start.
        ranges: parameters of the machine drawn for each episode.
        speeds: the least and the greatest speed that is commanded (m/s); None for no command.
        control_period: length of a step (s), see `RimlessWheelEnv`.
        dtype: "float32" or "float64".

    Raises:
        ValueError: an argument is out of its range, or float64 is not enabled in JAX.
    """

    params: GivenMachine = BUILDABLE
    task: Task = USUAL_TASK
    starts: Starts = USUAL_STARTS
    ranges: Ranges | None = None
    speeds: tuple[float, float] | None = None
    control_period: float = CONTROL_PERIOD
    dtype: str = "float32"

    def __post_init__(self) -> None:
        require_steppable(as_params(self.params))
        Control(self.control_period)  # refuses other periods
        if self.dtype not in NUMERICS:
            raise ValueError(f"dtype = {self.dtype!r}: choose from {', '.join(NUMERICS)}")
        if self.dtype == "float64" and not jax.config.jax_enable_x64:
            raise ValueError(
                "dtype = 'float64': JAX would make float32 of it; first call "
                "jax.config.update('jax_enable_x64', True)"
            )

    @property
    def default_params(self) -> EnvParams:
        """Episodes of 20 s."""
        return EnvParams(math.ceil(EPISODE_STEPS * CONTROL_PERIOD / self.control_period - 1e-9))

    def action_space(self, params: EnvParams | None = None) -> Box:
        """Share of the voltage limit, (1,)."""
        return Box(-1.0, 1.0, (1,), jnp.float32)

    def observation_space(self, params: EnvParams | None = None) -> Box:
        """Six numbers, or eight with a commanded speed."""
        bound = layout.OBSERVATION_BOUND if self.speeds is None else layout.COMMANDED_BOUND
        return Box(-bound, bound, bound.shape, jnp.float32)

    @functools.partial(jax.jit, static_argnums=0)
    def reset(self, key: Any, params: EnvParams | None = None) -> tuple[Any, EnvState]:
        """Begin an episode: (observation, state)."""
        machine_key, start_key, speed_key = jax.random.split(key, 3)
        bounds = {} if self.ranges is None else self.ranges.bounds
        shares = jax.random.uniform(machine_key, (len(bounds),), self.dtype)
        drawn = {
            name: low + (high - low) * share
            for (name, (low, high)), share in zip(bounds.items(), shares, strict=True)
        }
        machine, known = self._machine(drawn)
        usual = known.slope, known.weight, known.voltage_limit, self.starts.bounds

        def draw(tried: Any) -> Any:
            key, count, _, _ = tried
            key, now = jax.random.split(key)
            stream = iter(jax.random.uniform(now, (DRAWN,), self.dtype))
            pressed, mode, *y = _task.draw_state(*usual, machine.constants, stream, 0)
            y = [jnp.asarray(x, self.dtype) for x in y]
            return key, count + 1, pressed, (*y, jnp.asarray(mode, jnp.int32))

        first = draw((start_key, jnp.asarray(0), False, ()))
        drawing = jax.lax.while_loop(lambda t: ~t[2] & (t[1] < starts.DRAWS), draw, first)
        wheel = HybridState(*(*drawing[-1], jnp.asarray(0, jnp.int32)))
        speed = jnp.asarray(self.task.target_speed, self.dtype)
        if self.speeds is not None:
            speed = jax.random.uniform(speed_key, (), self.dtype, *self.speeds)
        allowance = jnp.asarray(known.allowance_limit, self.dtype)
        state = EnvState(wheel, jnp.asarray(0, jnp.int32), allowance, speed, drawn)
        return self.observe(state), state

    @functools.partial(jax.jit, static_argnums=0)
    def step(
        self, key: Any, state: EnvState, action: Any, params: EnvParams | None = None
    ) -> tuple[Any, EnvState, Any, Any, Any, dict[str, Any]]:
        """(observation, state, reward, terminated, truncated, info); begins the next episode.

        `info` has what is measured in the step, the terms of the reward, and
        `final_observation`, which is the last one of an episode that ends.
        """
        params = params or self.default_params
        step_key, reset_key = jax.random.split(key)
        final, after, reward, terminated, info = self.step_env(step_key, state, action, params)
        truncated = after.time >= params.max_steps_in_episode
        first, begun = self.reset(reset_key)
        ends = terminated | truncated
        seen, following = jax.tree.map(
            functools.partial(jnp.where, ends), (first, begun), (final, after)
        )
        info |= {"terminated": terminated, "truncated": truncated, "final_observation": final}
        return seen, following, reward, terminated, truncated, info

    def step_env(
        self, key: Any, state: EnvState, action: Any, params: EnvParams
    ) -> tuple[Any, EnvState, Any, Any, dict[str, Any]]:
        """`step` without the beginning of another episode, nor its end by time."""
        _, known = self._machine(state.drawn)
        share = jnp.clip(jnp.ravel(jnp.asarray(action, self.dtype))[0], -1.0, 1.0)
        wheel, totals = self.interval(state, known.voltage_limit * share)
        limit = state.target_speed if self.speeds is not None else self.task.target_speed
        travel, allowance = _task.rewarded(
            *(totals.distance, totals.elapsed, state.allowance, known.allowance_limit, limit)
        )
        interval = SimpleNamespace(
            **totals._asdict(),
            idle=known.idle_power * totals.elapsed,
            rewarded_travel=travel,
            failed=(totals.failure != OK) * 1.0,
        )
        terms = [getattr(_task, term.__name__)(interval, known, self.task) for term in task.TERMS]
        reward = functools.reduce(jnp.add, terms)
        after = state._replace(
            wheel=wheel, time=state.time + 1, allowance=jnp.asarray(allowance, self.dtype)
        )
        info = totals._asdict() | dict(zip(task.TERM_NAMES, terms, strict=True))
        return self.observe(after), after, reward, totals.failure != OK, info

    def interval(self, state: EnvState, volts: Any) -> tuple[HybridState, Totals]:
        """The wheel after one step at a constant voltage, and what is measured in it.

        Both can be differentiated by the state, by `volts` and by the drawn parameters, in
        forward and in reverse mode, through touchdowns.
        """
        given = state.wheel, jnp.asarray(volts, self.dtype), state.drawn
        period = self.control_period
        wheel, totals = advance(*given, lambda drawn: self._machine(drawn)[0], period)
        turns = jax.lax.stop_gradient(jnp.round(wheel.theta / (2 * np.pi)))
        return wheel._replace(theta=wheel.theta - 2 * np.pi * turns), totals

    def observe(self, state: EnvState) -> Any:
        """The observation, float32."""
        _, known = self._machine(state.drawn)
        wheel = state.wheel
        values = _task.observation(*wheel[:5], known.leg_scale)
        if self.speeds is not None:
            command = state.target_speed, state.allowance, known.allowance_limit
            values += _task.observed_command(*command)
        return jnp.stack([jnp.asarray(value, jnp.float32) for value in values])

    def _machine(self, drawn: Mapping[str, Any]) -> tuple[Machine, layout.TaskParams]:
        """The machine with some parameters drawn, and what the task needs to know of it."""
        params = as_params(self.params)
        fields = SimpleNamespace(**(dataclasses.asdict(params) | dict(drawn)))
        machine = Machine(params.constants, params.motor_pole)
        if drawn:
            fixed = machine.constants.d1, machine.constants.law
            p = Constants(*_task.constants_of(fields, *fixed, OF_ARRAYS["sin"], OF_ARRAYS["cos"]))
            machine = Machine(p, traced.hub_pole(p))
        known = layout.TaskParams(
            voltage_limit=fields.voltage_limit,
            idle_power=fields.idle_power,
            friction=fields.friction,
            weight=_task.weight_of(fields),
            slope=fields.slope,
            leg_scale=2 / _task.leg_angle_of(fields),
            allowance_limit=_task.step_length_of(fields),
        )
        return machine, known


class RejaxEnv(WheelEnv):
    """The environment as rejax 0.1 takes it: a step has five results, among them one end.

    rejax takes an end by time for a fall, so let episodes be long: `params.max_steps_in_episode`.
    """

    @functools.partial(jax.jit, static_argnums=0)
    def step(
        self, key: Any, state: EnvState, action: Any, params: EnvParams | None = None
    ) -> tuple[Any, EnvState, Any, Any, dict[str, Any]]:
        """(observation, state, reward, done, info); begins the next episode."""
        seen, after, reward, failed, late, info = super().step(key, state, action, params)
        return seen, after, reward, failed | late, info


def brax_env(env: WheelEnv) -> Any:
    """The environment as Brax's learners take it; they end its episodes by time themselves."""
    from brax.envs import Env, State  # only for those who have it

    class BraxEnv(Env):
        observation_size, action_size = len(env.observation_space().low), 1
        backend = "rimless_gym"

        def reset(self, rng: Any) -> Any:
            seen, state = env.reset(rng)
            return State(state, seen, jnp.zeros(()), jnp.zeros(()))

        def step(self, state: Any, action: Any) -> Any:
            given = None, state.pipeline_state, action, env.default_params
            seen, after, reward, failed, _ = env.step_env(*given)
            numbers = {"reward": jnp.float32(reward), "done": jnp.float32(failed)}
            return state.replace(pipeline_state=after, obs=seen, **numbers)

    return BraxEnv()
