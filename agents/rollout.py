"""Policies, and their walks in the vector environment: from given starts, or whole episodes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from agents.conditions import Conditions
from rimless_gym import RimlessWheelSpeedVectorEnv, RimlessWheelVectorEnv
from rimless_gym.checks import real_array
from rimless_gym.envs.layout import (
    COMMANDED_SIZE,
    LEG_RATE_SCALE,
    OBSERVATION_SIZE,
    PENDULUM_RATE_SCALE,
    observe,
)
from rimless_gym.envs.starts import draw_start
from rimless_gym.envs.task import Task
from rimless_gym.equations import DOUBLE, MODE_NAMES
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import FOOT, MODE, PHI, STATE_SIZE
from rimless_gym.params import WheelParams
from rimless_gym.presets import Machine, as_params
from rimless_gym.symbolic import HybridModel
from trajopt.feedback.adaptive import AdaptiveController
from trajopt.feedback.law import Controller, Floats, require_machine
from trajopt.identification import Log, Noise
from trajopt.pool import progress_bar

#: Titles of feedback laws that are not simply their names with spaces.
LAW_TITLES = {"input_output": "input-output", "lqr": "LQR", "pid": "PD"}

#: (states (N, 6), observations (N, 6 or 8)) -> actions (N,): voltages in units of the limit, in
#: [-1, 1]. Observations are what a learner may use. States are for feedback laws.
Policy: TypeAlias = Callable[[Floats, NDArray[np.float32]], Floats]

#: observations (N, 6 or 8) -> actions (N,) in [-1, 1]: the deterministic policy of a learner.
Act: TypeAlias = Callable[[NDArray[np.float32]], Floats]


#: () -> the numbers (M,) of those walks for whose states the policy is called next.
Running: TypeAlias = Callable[[], NDArray[np.int64]]


@dataclasses.dataclass(frozen=True)
class AdaptivePolicy:
    """An adaptive controller as a policy; by itself, it takes every call for a walk's first.

    Attributes:
        controller: in volts, clipped to the limit of its machine.
    """

    controller: AdaptiveController

    def begin(self, machines: Sequence[WheelParams], running: Running) -> Policy:
        """See `begun`; what the machines are it does not know."""
        walks = self.controller.begin(len(machines))
        limit = self.controller.params.voltage_limit

        def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
            modes = states[:, MODE].astype(np.int64)
            volts = walks(running(), states[:, :4], modes, states[:, FOOT])
            return np.clip(volts / limit, -1.0, 1.0)

        return policy

    def __call__(self, states: Floats, observations: NDArray[np.float32]) -> Floats:
        """The actions (N,) in [-1, 1]."""
        n = len(states)
        machines = (self.controller.params,) * n
        return self.begin(machines, lambda: np.arange(n))(states, observations)


def begun(policy: Policy, machines: Sequence[WheelParams], running: Running) -> Policy:
    """A policy for walks of these machines that begin now.

    One that has a method `begin` remembers each walk, or knows its machine; others are as they are.
    """
    begin = getattr(policy, "begin", None)
    return policy if begin is None else begin(machines, running)


@dataclasses.dataclass(frozen=True)
class ShapeChecked:
    """A learner's policy that refuses observations of another shape than it was trained on."""

    act: Act  # the policy
    size: int  # numbers of an observation, 6 or 8

    def __call__(self, observations: NDArray[np.float32]) -> Floats:
        """The actions, (N,); the action, (), for a single observation.

        Raises:
            ValueError: the observations are neither (N, size) nor (size,).
        """
        shape = np.shape(observations)
        if len(shape) not in (1, 2) or shape[-1] != self.size:
            size = self.size
            raise ValueError(f"observations: must have shape ({size},) or (N, {size}), not {shape}")
        return np.reshape(self.act(np.reshape(observations, (-1, self.size))), shape[:-1])


def learned_policy(act: Act) -> Policy:
    """A learner's policy, which sees the observations only."""

    def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
        return act(observations)

    return policy


def controller_policy(params: Machine, controller: Controller) -> Policy:
    """A feedback law in volts as a policy, clipped to the limit of a machine.

    Args:
        params: the machine, as the environment takes it.
        controller: the law.

    Raises:
        TypeError, ValueError: there is no such machine, or the law was made for another one.
    """
    machine = as_params(params)
    require_machine("controller", controller, machine)

    def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
        volts = controller(states[:, :4], states[:, MODE].astype(np.int64))
        return np.clip(np.asarray(volts, dtype=np.float64) / machine.voltage_limit, -1.0, 1.0)

    return policy


def true_state_policy(params: Machine, act: Act) -> Policy:
    """A learner's policy that sees the true state where sensors are noisy, to be imitated."""
    machine = as_params(params)

    def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
        seen = observations.copy()
        seen[:, :OBSERVATION_SIZE] = observe(machine, states)
        return act(seen)

    return policy


@dataclasses.dataclass(frozen=True)
class Predictor:
    """A policy in the shape of stable-baselines3's models, for what evaluates these.

    Attributes:
        policy: that acts; a feedback law is given the state that is observed.
        conditions: in which it acts.
    """

    policy: Policy
    conditions: Conditions

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return self.conditions.params

    def predict(
        self,
        observation: NDArray[np.float32],
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], Any]:
        """The actions, and `state` as it was given; policies have neither memory nor noise.

        Args:
            observation: one or N of them, (6,) or (N, 6); (8,) or (N, 8) with a commanded speed.
            state: of other policies' memories.
            episode_start: changes nothing.
            deterministic: changes nothing.

        Returns:
            Actions (1,) or (N, 1) in [-1, 1], and `state`.

        Raises:
            ValueError: the observations are of another shape.
        """
        size = COMMANDED_SIZE if self.conditions.commanded else OBSERVATION_SIZE
        actions = ShapeChecked(self._act, size)(np.asarray(observation, dtype=np.float32))
        return np.clip(actions, -1.0, 1.0).astype(np.float32)[..., np.newaxis], state

    def _act(self, observations: NDArray[np.float32]) -> Floats:
        states = np.zeros((len(observations), STATE_SIZE))
        states[:, :4] = measured(observations, self.params.leg_angle)
        states[:, MODE] = observations[:, OBSERVATION_SIZE - 1]
        return self.policy(states, observations)


def law_title(law: str) -> str:
    """The title of a law, one of `trajopt.feedback.laws.names()`, in tables and plots."""
    return LAW_TITLES.get(law, law.replace("_", " "))


class Interval(NamedTuple):
    """One control interval of the M walks that had not ended before it.

    Attributes:
        running: which of the walks these are, (M,).
        states: before the interval, (M, STATE_SIZE).
        observations: of these states, (M, 6); (M, 8) where a speed is commanded.
        actions: voltages commanded, in units of the limit, (M,).
        info: the environment's `info` of the interval, arrays (M,).
        after: states after the interval, (M, STATE_SIZE).
    """

    running: NDArray[np.int64]
    states: Floats
    observations: NDArray[np.float32]
    actions: Floats
    info: Mapping[str, NDArray[Any]]
    after: Floats


def draw_starts(params: WheelParams, n: int, seed: int | tuple[int, ...]) -> Floats:
    """The first `n` random starts (n, STATE_SIZE) of a seed; more starts leave these as they are.

    Raises:
        ValueError: n < 1.
    """
    if n < 1:
        raise ValueError(f"n = {n} starts: must be at least 1")
    rng = np.random.default_rng(seed)
    return np.stack([draw_start(params, rng) for _ in range(n)])


def at_rest(params: WheelParams) -> Floats:
    """On two feet, with the pendulum hanging: a hybrid state (STATE_SIZE,)."""
    state = np.zeros(STATE_SIZE)
    state[MODE], state[PHI] = DOUBLE, params.constants.a
    return state


class Rollout:
    """Walks of a policy, each until it falls or its time is up.

    Iterate over it, once, for the control intervals. A policy is given the state and the
    observation. Where sensors are noisy, the state that it is given is the measured one: the
    angles and rates in the noisy observation.

    Args:
        conditions: machine, control, ranges and disturbances.
        policy: see `Policy`.
        starts: (N, STATE_SIZE); every walk counts its legs from the foot it begins on.
        n_intervals: length of the walks in control intervals.
        seed: walk i draws its machine and its disturbances from `seed + i`, or from `seed[i]`.
        task: whose rewards are in `info`, default: that of the environment.
        command: the speed that is commanded all the time (m/s), one or one for each walk; None:
            none is, or each walk draws its own where the conditions have speeds.
        machines: of each walk, instead of that of the conditions.

    Attributes:
        machines: of each walk, as drawn, N of them.
        running: which walks have not ended, (M,); those for which the policy is called.

    Raises:
        TypeError: the policy gives no real numbers.
        ValueError: the policy gives NaN or the wrong shape, a start is not a state in which the
            foot can press on the ground, or a speed is commanded where none is observed.
    """

    def __init__(
        self,
        conditions: Conditions,
        policy: Policy,
        starts: Floats,
        n_intervals: int,
        seed: int | Sequence[int] = 0,
        task: Task | None = None,
        command: float | Floats | None = None,
        machines: Sequence[WheelParams] | None = None,
    ) -> None:
        starts = np.asarray(starts, dtype=np.float64).reshape(-1, STATE_SIZE)
        modes = [MODE_NAMES[int(mode)] for mode in starts[:, MODE]]
        begin: dict[str, Any] = {"state": starts[:, :4].copy(), "mode": modes}
        if command is not None:
            begin["speed"] = command
        self._envs = conditions.envs(
            len(starts),
            params=conditions.params if machines is None else list(machines),
            task=task,
            max_episode_steps=None,
        )
        self._seen, _ = self._envs.reset(seed=seed, options=begin)
        self._n_intervals, self.running = n_intervals, np.arange(len(starts))
        self._noisy = conditions.disturbances.sensor_noise is not None
        self.machines: tuple[WheelParams, ...] = self._envs.params
        self._policy = begun(policy, self.machines, lambda: self.running)

    def command(self, speed: float | Floats) -> None:
        """Command another speed (m/s), one or one to each walk; it is observed an interval later.

        Raises:
            ValueError: no speed is observed in these walks, or it is out of its range.
        """
        if not isinstance(self._envs, RimlessWheelSpeedVectorEnv):
            raise ValueError(f"speed = {speed}: none is commanded in these walks")
        self._envs.set_command(speed)

    def __iter__(self) -> Iterator[Interval]:
        envs, observations = self._envs, self._seen
        states = envs.states
        for _ in range(self._n_intervals):
            running = self.running
            if len(running) == 0:
                return
            now, seen = states[running], observations[running]
            actions = self._actions(now, seen)
            commands = np.zeros((envs.num_envs, 1))
            commands[running, 0] = actions
            observations, _, fell, _, info = envs.step(commands)
            states = envs.states
            own = {name: values[running] for name, values in info.items()}
            yield Interval(running, now, seen, actions, own, states[running])
            self.running = running[~fell[running]]
            if fell.any():  # a walk that has ended rests from then on, and does not stop the others
                envs.reset(options={"mode": "double_stance", "reset_mask": fell})

    def _actions(self, states: Floats, observations: NDArray[np.float32]) -> Floats:
        given = states.copy()  # a policy may write into what it is given
        if self._noisy:
            given[:, :4] = measured(observations, self.machines[0].leg_angle)
        actions = real_array("the policy's actions", self._policy(given, observations.copy()))
        actions = np.clip(actions, -1.0, 1.0)
        if actions.shape != (len(states),) or np.isnan(actions).any():
            raise ValueError(
                f"the policy gave shape {actions.shape} with {np.isnan(actions).sum()} NaN for "
                f"{len(states)} states: it must give one number in [-1, 1] for each"
            )
        return actions


def measured(observations: NDArray[np.float32], leg_angle: float) -> Floats:
    """phi, theta, phi', theta' (N, 4) from observations (N, 6 or 8); theta is in [-pi, pi]."""
    seen = observations.astype(np.float64)
    return np.stack(
        [
            math.pi / 2 + seen[:, 0] * leg_angle / 2,
            np.arctan2(seen[:, 1], seen[:, 2]),
            seen[:, 3] * LEG_RATE_SCALE,
            seen[:, 4] * PENDULUM_RATE_SCALE,
        ],
        axis=1,
    )


@dataclasses.dataclass(frozen=True)
class Episode:
    """One episode of T steps, by which the single environment repeats it bit for bit.

    Attributes:
        seed, options: of `reset`; options are None where it was given none.
        observations: the first one and those of all steps, float32 (T + 1, width).
        actions: float32 (T, 1).
        rewards, terminations, truncations: (T,); the last termination or truncation is True.
        infos: entries of `info` that were asked for, first those of the reset, (T + 1,) each.
    """

    seed: int
    options: dict[str, Any] | None
    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: Floats
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]
    infos: dict[str, NDArray[Any]]

    @property
    def total(self) -> float:
        """The return: the sum of all rewards (m)."""
        return float(self.rewards.sum())


def episodes(
    envs: RimlessWheelVectorEnv,
    policy: Policy,
    seed: int = 0,
    *,
    options: dict[str, Any] | None = None,
    keep: Sequence[str] = (),
    progress: str | None = None,
) -> list[Episode]:
    """One episode in each row of a vector environment, from its reset to its end.

    Args:
        envs: with a limit of steps.
        policy: see `Policy`; its actions are rounded to float32.
        seed: row i is reset with `seed + i`.
        options: of `reset`, which must suit a single environment too.
        keep: entries of `info` to keep.
        progress: title of a progress bar, or None for no bar.

    Raises:
        ValueError: the policy gives NaN or the wrong shape, or an option is not valid.
    """
    observations, info = envs.reset(seed=seed, options=options)
    running, lengths = np.ones(envs.num_envs, dtype=bool), np.zeros(envs.num_envs, dtype=int)
    seen, noted, steps = [observations], [[info[name] for name in keep]], []
    length = envs.max_episode_steps
    policy = begun(policy, envs.params, lambda: running.nonzero()[0])
    with progress_bar(progress or "", bool(progress), total=length, leave=False) as bar:
        while running.any():
            rows = running.nonzero()[0]
            actions = np.zeros((envs.num_envs, 1), dtype=np.float32)
            actions[rows, 0] = np.clip(policy(envs.states[rows], observations[rows]), -1.0, 1.0)
            observations, rewards, terminated, truncated, info = envs.step(actions)
            seen.append(observations)
            noted.append([info[name] for name in keep])
            steps.append((actions, rewards, terminated, truncated))
            lengths[rows] += 1
            running &= ~(terminated | truncated)
            bar.update()
    taken, rewarded, terminations, truncations = map(np.array, zip(*steps, strict=True))
    infos = dict(zip(keep, (np.array(column) for column in zip(*noted, strict=True)), strict=True))
    states = np.array(seen)
    return [
        Episode(
            seed + row,
            options,
            states[: length + 1, row],
            taken[:length, row],
            rewarded[:length, row],
            terminations[:length, row],
            truncations[:length, row],
            {name: column[: length + 1, row] for name, column in infos.items()},
        )
        for row, length in enumerate(lengths.tolist())
    ]


def logged(
    policy: Policy,
    params: WheelParams,
    start: Floats,
    seconds: float,
    noise: Noise | None = None,
    seed: int = 0,
) -> Log:
    """The log of a policy's walk until it falls, `seconds` long at most.

    Args:
        policy: it is given the true state.
        params: the machine that walks.
        start: hybrid state (STATE_SIZE,).
        seconds: to log.
        noise: standard deviations of the sensors' errors, which are normally distributed.
        seed: of the errors.

    Raises:
        ValueError: see `Rollout`.
    """
    noise = noise or Noise()
    walk = Rollout(Conditions(params), policy, start[None], round(seconds / CONTROL_PERIOD))
    intervals = list(walk)
    states = np.concatenate([each.states for each in intervals])
    volts = params.voltage_limit * np.concatenate([each.actions for each in intervals])
    current = HybridModel(params).functions["motor_current"].map(len(volts))
    columns = np.vstack([states[:, :4].T, current(states[:, :4].T, volts[None]).full()])
    sd = np.array([noise.angle, noise.angle, noise.rate, noise.rate, noise.current])
    errors = np.random.default_rng(seed).standard_normal(columns.shape)
    phi, theta, dphi, dtheta, amps = columns + sd[:, None] * errors
    time = np.asarray(CONTROL_PERIOD * np.arange(len(volts)), dtype=np.float64)
    return Log(time, phi, theta, states[:, FOOT], states[:, MODE], volts, amps, dphi, dtheta)
