"""The evaluation protocol: how well a policy walks, the same way for every policy.

A deterministic policy walks for 50 s from 128 fixed starts, rest among them. What counts is the
last 30 s of those that still walk, as ratios of sums: short windows and medians of ratios
mis-state a cost of transport by 1 to 3 %.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from agents.periods import TouchdownLog, steps_per_period
from agents.policies import Floats, Policy
from agents.rollout import draw_starts, rollout
from rimless_gym.checks import flag, integer, real, real_array, require_callable, require_kind
from rimless_gym.energy import ROW, Ledger
from rimless_gym.envs.task import Task
from rimless_gym.hybrid import CONTROL_PERIOD, OK
from rimless_gym.kernel.stepping import STATE_SIZE
from rimless_gym.params import THESIS_PHYSICAL, WheelParams
from trajopt.files import jsonable

_LARGEST = [ROW.friction_demand, ROW.impulse_friction_demand]
_LEAST = [ROW.min_normal_force, ROW.clearance]
_SUMMED = ROW.touchdowns + 1  # the rows before this one are sums


@dataclasses.dataclass(frozen=True)
class Protocol:
    """From where, for how long, and over which part a policy is judged.

    Attributes:
        starts: number of starts.
        seed: of the starts; never that of a training.
        duration: of a walk (s).
        window: at its end, over which everything is measured (s).
        alive: at its end, in which a walk must still take net forward steps (s).

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: not 0 < alive <= window <= duration, each a period of control at least, starts
            < 1, or seed < 0.
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
            seconds = real(name, getattr(self, name))
            if 0.0 < seconds < CONTROL_PERIOD:
                raise ValueError(
                    f"{name} = {seconds} s: must be at least {CONTROL_PERIOD} s, a control period"
                )
        if not 0 < self.alive <= self.window <= self.duration:
            raise ValueError(
                f"alive = {self.alive} s, window = {self.window} s, duration = {self.duration} s: "
                "must be positive and grow in this order"
            )


#: The protocol of every published figure.
PROTOCOL = Protocol()

#: A shorter one, for keeping the best of many checkpoints during training.
SHORT_PROTOCOL = Protocol(starts=48, seed=20150502, duration=20.0, window=10.0, alive=5.0)


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """How a policy walks. Figures of walking are NaN where no start walks.

    Attributes:
        protocol: what was asked for.
        walking_share: of the starts, in [0, 1].
        speed: distance over time (m/s).
        cot: cost of transport from E+, without regeneration.
        cot_with_regeneration: from E.
        friction_demand: largest |Fx| / Fy in stance.
        impulse_friction_demand: the same of the touchdowns' impulses.
        min_normal_force: least Fy (N).
        min_clearance: least height of the pendulum's end over the ground (m).
        steps_per_period: the commonest period among the walks, 0 if they repeat within none.
        objective: mean reward per second over all starts (m/s); a start that fell counts as
            having paid the task's fall cost within the window.
        ledger: sums over the windows of those that walk.
        walking, fallen: of each start, (starts,).
        speeds, cots: of each start's own window, (starts,), NaN where it does not walk.
        periods: of each start, (starts,).
    """

    protocol: Protocol
    walking_share: float
    speed: float
    cot: float
    cot_with_regeneration: float
    friction_demand: float
    impulse_friction_demand: float
    min_normal_force: float
    min_clearance: float
    steps_per_period: int
    objective: float
    ledger: Ledger
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
    params: WheelParams = THESIS_PHYSICAL,
    protocol: Protocol = PROTOCOL,
    *,
    task: Task | None = None,
    starts: Floats | None = None,
    progress: bool = False,
) -> Evaluation:
    """Let a policy walk and measure it.

    Args:
        policy: see `agents.policies`.
        params: the machine.
        protocol: starts and times.
        task: whose reward `objective` is.
        starts: (protocol.starts, STATE_SIZE) instead of the protocol's own.
        progress: whether to show a progress bar.

    Raises:
        TypeError: an argument is of the wrong kind.
        ValueError: the policy gives NaN or the wrong shape, or `starts` are of another shape or not
            finite.
    """
    require_callable("policy", policy)
    require_kind("params", params, WheelParams)
    require_kind("protocol", protocol, Protocol)
    if task is not None:
        require_kind("task", task, Task)
    progress = flag("progress", progress)
    if starts is None:
        starts = draw_starts(params, protocol.starts, protocol.seed)
    starts = _checked_starts(starts)
    n = len(starts)
    n_intervals = round(protocol.duration / CONTROL_PERIOD)
    first = n_intervals - round(protocol.window / CONTROL_PERIOD)
    first_alive = n_intervals - round(protocol.alive / CONTROL_PERIOD)
    totals = np.zeros((n, len(ROW)))
    totals[:, _LEAST] = np.inf
    late_steps = np.zeros(n)
    fallen = np.zeros(n, dtype=bool)
    log = TouchdownLog(params, n)
    intervals = rollout(params, policy, starts, n_intervals)
    bar = tqdm(intervals, total=n_intervals, desc="evaluate", disable=not progress, leave=False)
    for index, interval in enumerate(bar):
        i, rows = interval.running, interval.rows
        fallen[i] = rows[:, ROW.failure] != OK
        if index < first:
            continue
        totals[i, :_SUMMED] += rows[:, :_SUMMED]
        for column in _LARGEST:
            totals[i, column] = np.maximum(totals[i, column], rows[:, column])
        for column in _LEAST:
            totals[i, column] = np.minimum(totals[i, column], rows[:, column])
        log.note(interval)
        if index >= first_alive:
            late_steps[i] += rows[:, ROW.steps]
    walking = (late_steps > 0) & ~fallen
    periods = np.array([steps_per_period(points) for points in log.points()])
    periods[~walking] = 0
    return _summary(params, protocol, task or Task(), totals, walking, fallen, periods)


def _checked_starts(starts: Any) -> Floats:
    """`starts` as an array of states (N, STATE_SIZE)."""
    states = real_array("starts", starts)
    if states.ndim != 2 or not len(states) or states.shape[1] != STATE_SIZE:
        raise ValueError(f"starts: of shape {states.shape}, not (1 or more, {STATE_SIZE})")
    if not np.isfinite(states).all():
        raise ValueError("starts: must all be finite")
    return states.astype(np.float64, copy=False)


def _summary(
    params: WheelParams,
    protocol: Protocol,
    task: Task,
    totals: Floats,
    walking: NDArray[np.bool_],
    fallen: NDArray[np.bool_],
    periods: NDArray[np.int64],
) -> Evaluation:
    energy = totals[:, ROW.electrical_positive] + params.idle_power * totals[:, ROW.elapsed]
    terms = task.reward_terms(params, totals[:, ROW.distance], energy, fallen)
    ledger = Ledger.from_rows(totals[walking].sum(axis=0), params)
    own = [Ledger.from_rows(rows, params) for rows in totals]
    some = bool(walking.any())

    def extreme(column: int) -> float:
        values = totals[walking, column]
        if not some:
            return math.nan
        return float(values.max() if column in _LARGEST else values.min())

    return Evaluation(
        protocol=protocol,
        walking_share=float(walking.mean()),
        speed=ledger.distance / ledger.time if some else math.nan,
        cot=ledger.cost_of_transport(params),
        cot_with_regeneration=ledger.cost_of_transport(params, regeneration=True),
        friction_demand=extreme(ROW.friction_demand),
        impulse_friction_demand=extreme(ROW.impulse_friction_demand),
        min_normal_force=extreme(ROW.min_normal_force),
        min_clearance=extreme(ROW.clearance),
        steps_per_period=int(np.bincount(periods[walking]).argmax()) if some else 0,
        objective=float(sum(terms).mean()) / protocol.window,
        ledger=ledger,
        walking=walking,
        fallen=fallen,
        speeds=np.array(
            [x.distance / x.time if w else np.nan for x, w in zip(own, walking, strict=True)]
        ),
        cots=np.array(
            [
                x.cost_of_transport(params) if w else np.nan
                for x, w in zip(own, walking, strict=True)
            ]
        ),
        periods=periods,
    )
