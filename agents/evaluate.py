"""The evaluation protocol: how well a policy walks, the same way for every policy.

A deterministic policy walks for 50 s from 128 fixed starts, rest among them. A start counts as
walking if it still takes steps in the last 10 s, and keeps the rules of `rimless_gym.rules` in the
last 30 s: the foot is pressed down and does not slip, and the pendulum does not touch the floor.
Optimal gaits keep the same rules. What is measured is the last 30 s of those that walk, from the
first to the last touchdown, as ratios of sums: short windows and medians of ratios mis-state a cost
of transport by 1 to 3 %, and parts of steps by 0.1 %.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents.conditions import Conditions
from agents.outcomes import (
    FALLS,
    STOPS,
    WALKS,
    TouchdownLog,
    WindowTotals,
    count_failures,
    outcomes,
    steps_per_period,
)
from agents.rollout import Policy, Rollout, draw_starts
from rimless_gym.checks import flag, integer, real, real_array, require_callable, require_kind
from rimless_gym.energy import Ledger
from rimless_gym.envs import EPISODE_STEPS
from rimless_gym.envs.arguments import as_task
from rimless_gym.envs.disturbances import Disturbances, Ranges
from rimless_gym.envs.speed import SPEEDS
from rimless_gym.envs.task import TERM_NAMES, Task
from rimless_gym.hybrid import CONTROL_PERIOD, OK
from rimless_gym.kernel.stepping import STATE_SIZE
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE, Machine
from trajopt.feedback.law import Floats
from trajopt.pool import progress_bar
from trajopt.store import jsonable


@dataclasses.dataclass(frozen=True)
class Protocol:
    """From where, for how long, and over which part of its walks a policy is measured.

    Attributes:
        starts: number of starts.
        seed: of the starts; never that of a training.
        duration: of a walk (s).
        window: at its end, over which everything is measured (s).
        alive: at its end, in which a walk must still take net forward steps (s).

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: not 0 < alive <= window <= duration, starts < 1, or seed < 0.
    """

    starts: int = 128
    seed: int = 20150501
    duration: float = 50.0
    window: float = 30.0
    alive: float = 10.0

    def __post_init__(self) -> None:
        integer("starts", self.starts, 1)
        integer("seed", self.seed, 0)
        for name in ("duration", "window", "alive"):
            real(name, getattr(self, name))
        if not 0 < self.alive <= self.window <= self.duration:
            raise ValueError(
                f"alive = {self.alive} s, window = {self.window} s, duration = {self.duration} s: "
                "must be positive and grow in this order"
            )


#: The protocol of every published figure.
PROTOCOL = Protocol()

#: With fewer starts and shorter walks, for policies that are changed or disturbed in many ways.
SHORT_PROTOCOL = Protocol(starts=48, seed=20150502, duration=20.0, window=10.0, alive=5.0)

#: For selecting the best of many checkpoints during training. The walks are as long as the
#: published ones: a gait can last 20 s from every start, and 50 s from none.
TRAINING_PROTOCOL = Protocol(starts=48, seed=20150502, duration=50.0, window=10.0, alive=5.0)

#: Length of an episode of `RimlessWheel-v0` (s), whose return is measured too.
EPISODE = EPISODE_STEPS * CONTROL_PERIOD

#: A slow command, a usual one, and one near the fastest that an episode may draw (m/s).
COMMANDS = (0.35, 0.5, 0.6)

#: Of several trainings, a seed walks if its policy walks from this share of the starts.
ENOUGH = 0.95

#: Between the commands at which a policy is evaluated for the range that it was trained for (m/s).
COMMAND_STEP = 0.02

#: Speed and cost of transport of a start that does not walk.
_NO_WALK = math.nan, math.nan


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """How a policy walks. Figures of walking are NaN where no start walks.

    The extremes are those of all starts that still take steps at the end, so that they show why
    some do not count; NaN where none does.

    Attributes:
        protocol: starts and times.
        walking_share: of the starts, in [0, 1].
        failures: how many starts do not count, by outcome (`agents.outcomes.OUTCOMES`).
        speed: distance over time, from the first to the last touchdown in the window (m/s).
        cot: cost of transport from E+, without regeneration.
        cot_with_regeneration: from E.
        friction_demand: largest |Fx| / Fy in stance.
        impulse_friction_demand: the same of the touchdowns' impulses.
        min_normal_force: least Fy (N).
        min_normal_force_over_weight: least Fy in weights of its machine.
        min_clearance: least height of the pendulum's end over the ground (m).
        steps_per_period: the most common period among the walks; 0 stands for none.
        objective: mean reward per second over all starts (m/s); a start that fell counts as
            penalised for its fall within the window.
        ledger: sums over the whole steps in the windows of those that walk.
        returns: of an episode of 20 s, or of a shorter protocol, from each start (m), (starts,).
        outcomes: of each start.
        walking, fallen: of each start, (starts,).
        speeds, cots: of each start's own steps, (starts,), NaN where it does not walk.
        periods: of each start, (starts,).
    """

    protocol: Protocol
    walking_share: float
    failures: dict[str, int]
    speed: float
    cot: float
    cot_with_regeneration: float
    friction_demand: float
    impulse_friction_demand: float
    min_normal_force: float
    min_normal_force_over_weight: float
    min_clearance: float
    steps_per_period: int
    objective: float
    ledger: Ledger
    returns: Floats
    outcomes: tuple[str, ...]
    walking: NDArray[np.bool_]
    fallen: NDArray[np.bool_]
    speeds: Floats
    cots: Floats
    periods: NDArray[np.int64]

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain JSON values, NaN as None."""
        values: dict[str, Any] = {
            field.name: getattr(self, field.name) for field in dataclasses.fields(self)
        }
        values["protocol"] = dataclasses.asdict(self.protocol)
        values["ledger"] = self.ledger.to_dict()
        return dict(jsonable(values))


def evaluate(
    policy: Policy,
    params: Machine = BUILDABLE,
    protocol: Protocol = PROTOCOL,
    *,
    task: Task | Mapping[str, float] | None = None,
    ranges: Ranges | Mapping[str, Any] | None = None,
    disturbances: Disturbances | Mapping[str, Any] | None = None,
    starts: Floats | None = None,
    machines: Sequence[WheelParams] | None = None,
    command: float | Floats | None = None,
    control_period: float | None = None,
    progress: bool = True,
) -> Evaluation:
    """Let a policy walk in the vector environment, and measure it.

    Args:
        policy: see `agents.rollout`.
        params: the machine, as the environment takes it.
        protocol: starts and times.
        task: whose reward `objective` is, as the environment takes it.
        ranges: of parameters, as the environment takes them. Each walk draws its own machine.
        disturbances: as the environment takes them.
        starts: (N, STATE_SIZE) instead of the protocol's own.
        machines: of each start, N of them, instead of `params` for all.
        command: the speed that is commanded (m/s), in `RimlessWheelSpeed-v0`, one or one for each
            start; None: the policy walks in `RimlessWheel-v0`. See also `evaluate_commanded`.
        control_period: how long an action is held (s), default: that of the environment.
        progress: whether to show a progress bar on a terminal.

    Raises:
        TypeError: an argument is of the wrong kind.
        ValueError: the policy gives NaN or the wrong shape, `starts` are of another shape, not
            finite or not states to start from, `machines` are not as many or have other numbers of
            legs, ranges or disturbances are not valid, or the command or the control period is out
            of its range, or longer than the protocol's shortest span.
        RuntimeError: a machine that was drawn cannot stand at its start.
    """
    require_callable("policy", policy)
    require_kind("protocol", protocol, Protocol)
    progress = flag("progress", progress)
    speeds = None if command is None else SPEEDS
    conditions = Conditions.of(params, ranges, disturbances, speeds, control_period)
    params = conditions.params
    if starts is None:
        starts = draw_starts(params, protocol.starts, protocol.seed)
    starts = real_array("starts", starts)
    if starts.ndim != 2 or starts.shape[1] != STATE_SIZE or not np.isfinite(starts).all():
        raise ValueError(f"starts: must be finite, of shape (N, {STATE_SIZE})")
    if machines is not None:
        machines = tuple(machines)
        if len(machines) != len(starts):
            raise ValueError(
                f"machines: {len(machines)} for {len(starts)} starts; give one for each"
            )
        for k, machine in enumerate(machines):
            require_kind(f"machines[{k}]", machine, WheelParams)
            if machine.n_legs != params.n_legs:
                raise ValueError(
                    f"machines[{k}]: n_legs = {machine.n_legs}: must be {params.n_legs}, as of "
                    "params"
                )
    task, period = as_task(task, conditions.default_task), conditions.control.period
    if protocol.alive < period:
        raise ValueError(
            f"alive = {protocol.alive} s: must be at least the control period, {period} s"
        )
    n_intervals = round(protocol.duration / period)
    first = n_intervals - round(protocol.window / period)
    first_alive = n_intervals - round(protocol.alive / period)
    walks = Rollout(conditions, policy, starts, n_intervals, protocol.seed, task, command, machines)
    window = WindowTotals(walks.machines)
    log = TouchdownLog(len(starts))
    late_steps, returns = np.zeros(len(starts)), np.zeros(len(starts))
    fallen, penalties = np.zeros(len(starts), dtype=bool), np.zeros(len(starts))
    bar = progress_bar("evaluate", progress, iterable=walks, total=n_intervals, leave=False)
    for index, interval in enumerate(bar):
        fallen[interval.running] = interval.info["failure"] != OK
        penalties[interval.running] = interval.info["reward_end"]
        if index < round(EPISODE / period):
            returns[interval.running] += sum(interval.info[name] for name in TERM_NAMES)
        if index < first:
            continue
        window.add(interval)
        log.add(interval, index * period)
        if index >= first_alive:
            late_steps[interval.running] += interval.info["steps"]
    results = outcomes(fallen, late_steps > 0, window)
    periods = np.array([steps_per_period(times) for times in log.times])
    objective = float(window.rewards(penalties).mean()) / protocol.window
    return _summary(params, protocol, window, objective, returns, results, periods)


def _summary(
    params: WheelParams,
    protocol: Protocol,
    window: WindowTotals,
    objective: float,
    returns: Floats,
    results: tuple[str, ...],
    periods: NDArray[np.int64],
) -> Evaluation:
    walking, fallen = (np.array([each == what for each in results]) for what in (WALKS, FALLS))
    stepping = ~np.isin(results, (FALLS, STOPS))
    some = bool(walking.any())
    periods = np.where(walking, periods, 0)
    weights = np.array([machine.weight for machine in window.machines])
    ledger, weighted = window.total(walking, params)
    each_walk = [
        (each.distance / each.time, each.cost_of_transport(machine)) if walks else _NO_WALK
        for each, machine, walks in zip(window.ledgers(), window.machines, walking, strict=True)
    ]
    return Evaluation(
        protocol=protocol,
        walking_share=float(walking.mean()),
        failures=count_failures(results),
        speed=ledger.distance / ledger.time if some else math.nan,
        cot=weighted.cost_of_transport(params),
        cot_with_regeneration=weighted.cost_of_transport(params, regeneration=True),
        friction_demand=window.extreme("friction_demand", stepping),
        impulse_friction_demand=window.extreme("impulse_friction_demand", stepping),
        min_normal_force=window.extreme("min_normal_force", stepping),
        min_normal_force_over_weight=window.extreme("min_normal_force", stepping, weights),
        min_clearance=window.extreme("clearance", stepping),
        steps_per_period=int(np.bincount(periods[walking]).argmax()) if some else 0,
        objective=objective,
        ledger=ledger,
        returns=returns,
        outcomes=results,
        walking=walking,
        fallen=fallen,
        speeds=np.array([speed for speed, _ in each_walk]),
        cots=np.array([cot for _, cot in each_walk]),
        periods=periods,
    )


def evaluate_commanded(
    policy: Policy,
    commands: Sequence[float] = COMMANDS,
    params: Machine = BUILDABLE,
    protocol: Protocol = PROTOCOL,
    *,
    task: Task | Mapping[str, float] | None = None,
    control_period: float | None = None,
    progress: bool = True,
) -> tuple[Evaluation, ...]:
    """Evaluate a policy at each of some speeds that `RimlessWheelSpeed-v0` commands.

    Each speed is commanded for whole walks, from the same starts.

    Args:
        policy: see `agents.rollout`; it is given observations (N, 8).
        commands: the speeds (m/s), one or more.
        params: the wheel's parameters, as the environment takes them.
        protocol: starts and times.
        task: whose reward `objective` is, as the environment takes it.
        control_period: as the environment takes it.
        progress: whether to show a progress bar for each speed.

    Raises:
        TypeError: an argument is of the wrong kind.
        ValueError: no speed is given or one is out of its range; also see `evaluate`.
        RuntimeError: see `evaluate`.
    """
    speeds = real_array("commands", commands)
    if speeds.ndim != 1 or not len(speeds):
        raise ValueError(f"commands = {commands!r}: give one or more speeds (m/s)")
    return tuple(
        evaluate(
            policy,
            params,
            protocol,
            task=task,
            command=speed,
            control_period=control_period,
            progress=progress,
        )
        for speed in speeds.tolist()
    )


def commands_within(slowest: float, fastest: float) -> list[float]:
    """The commands at which a policy is evaluated that was trained for these (m/s).

    They are the multiples of `COMMAND_STEP` in the range; its ends, where it has none.
    """
    first, last = (
        math.ceil(slowest / COMMAND_STEP - 1e-9),
        math.floor(fastest / COMMAND_STEP + 1e-9),
    )
    return [round(n * COMMAND_STEP, 6) for n in range(first, last + 1)] or [slowest, fastest]


def interquartile_mean(values: ArrayLike) -> float:
    """Mean of the middle half of `values`, (seeds,) or (seeds, tasks).

    Raises:
        ValueError: there are none, or one is not finite.
    """
    return float(_trimmed_mean(_scores(values).ravel()))


def bootstrap_interval(
    values: ArrayLike, resamples: int = 10_000, seed: int = 0
) -> tuple[float, float]:
    """95 % percentile interval of the interquartile mean, seeds resampled within each task.

    Args:
        values: (seeds,) or (seeds, tasks).
        resamples: number of bootstrap samples.
        seed: of the resampling.

    Raises:
        ValueError: values are missing or not finite.
    """
    scores = _scores(values)
    n_seeds, n_tasks = scores.shape
    picks = np.random.default_rng(seed).integers(n_seeds, size=(resamples, n_seeds, n_tasks))
    drawn = scores[picks, np.arange(n_tasks)].reshape(resamples, -1)
    low, high = np.quantile(_trimmed_mean(drawn), [0.025, 0.975])
    return float(low), float(high)


def _scores(values: ArrayLike) -> NDArray[np.float64]:
    scores = np.asarray(values, dtype=np.float64)
    if scores.ndim == 1:
        scores = scores[:, np.newaxis]
    if scores.ndim != 2 or scores.size == 0 or not np.isfinite(scores).all():
        raise ValueError(
            f"values = {values!r}: give finite numbers of shape (seeds,) or (seeds, tasks); "
            "leave out seeds that do not walk, and report their share"
        )
    return scores


def _trimmed_mean(scores: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean of the middle half along the last axis; values at its ends count in part."""
    n = scores.shape[-1]
    weights = np.clip(np.minimum(np.arange(1, n + 1) - n / 4, 3 * n / 4 - np.arange(n)), 0, 1)
    return np.sort(scores, axis=-1) @ weights / weights.sum()
