"""How well a policy walks at the speeds that `RimlessWheelSpeed-v0` commands.

At each speed by itself, the policy is measured as every other one: from the same starts, for the
same time, by the same rules (`agents.evaluate`). The command stays as it is for the whole walk.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from agents.conditions import Conditions
from agents.evaluate import PROTOCOL, Evaluation, Protocol, evaluate
from agents.outcomes import FALLS, WALKS, Window, outcomes
from agents.policies import Policy
from agents.rollout import Rollout, draw_starts
from rimless_gym.checks import positive, real_array
from rimless_gym.envs.speed import SPEEDS
from rimless_gym.envs.task import Task
from rimless_gym.hybrid import OK
from rimless_gym.presets import BUILDABLE, Machine

#: The outcomes of walks whose foot slips, in stance or as it touches down.
SLIPS = ("slips", "slips_at_touchdown")

#: A slow command, a usual one, and one near the fastest that an episode may draw (m/s).
COMMANDS = (0.35, 0.5, 0.6)

#: Between the commands at which a policy is evaluated for the range that it was trained for (m/s).
STEP = 0.02


def evaluate_commanded(
    policy: Policy,
    commands: Sequence[float] = COMMANDS,
    params: Machine = BUILDABLE,
    protocol: Protocol = PROTOCOL,
    *,
    task: Task | Mapping[str, float] | None = None,
    control_period: float | None = None,
    progress: bool = False,
) -> tuple[Evaluation, ...]:
    """Evaluate a policy at each of some commanded speeds by itself.

    Args:
        policy: see `agents.policies`; it is given observations (N, 8).
        commands: the speeds (m/s), one or more.
        params: the wheel's parameters, as the environment takes them.
        protocol: starts and times.
        task: whose reward `objective` is, as the environment takes it.
        control_period: as the environment takes it.
        progress: whether to show a progress bar for each speed.

    Raises:
        TypeError: an argument is of the wrong kind.
        ValueError: no speed is given or one is out of its range, or as `evaluate` says.
        RuntimeError: as `evaluate` says.
    """
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
        for speed in _speeds(commands)
    )


@dataclasses.dataclass(frozen=True)
class Stretch:
    """The end of a walk under one of several commands: as long as half a command lasts.

    Attributes:
        command: the speed that is commanded (m/s).
        walking_share: of all starts, those that have not fallen yet, still step and keep the rules.
        fallen_share: those that have fallen, then or before.
        slipping_share: those that still step, but whose foot slips.
        speed: of those that walk (m/s); NaN if there is none.
        cot: cost of transport of these, from E+; NaN if there is none.
    """

    command: float
    walking_share: float
    fallen_share: float
    slipping_share: float
    speed: float
    cot: float


def walk_through(
    policy: Policy,
    commands: Sequence[float],
    params: Machine = BUILDABLE,
    protocol: Protocol = PROTOCOL,
    *,
    seconds: float = 10.0,
    control_period: float | None = None,
) -> tuple[Stretch, ...]:
    """Let a policy walk on while the command changes.

    Args:
        policy: see `agents.policies`; it is given observations (N, 8).
        commands: the speeds (m/s), one after the other.
        params: the wheel's parameters, as the environment takes them.
        protocol: starts.
        seconds: for which each command lasts; the first lasts twice as long, to get going.
        control_period: as the environment takes it.

    Raises:
        TypeError: an argument is of the wrong kind.
        ValueError: no speed is given or one is out of its range, or as `evaluate` says.
        RuntimeError: as `evaluate` says.
    """
    speeds = _speeds(commands)
    conditions = Conditions.of(params, None, None, SPEEDS, control_period)
    each = round(positive("seconds", seconds) / conditions.control.period)
    starts = draw_starts(conditions.params, protocol.starts, protocol.seed)
    n_intervals = (len(speeds) + 1) * each
    walks = Rollout(conditions, policy, starts, n_intervals, protocol.seed, command=speeds[0])
    fallen, stretches = np.zeros(len(starts), dtype=bool), []
    for k, interval in enumerate(walks):
        fallen[interval.running] = interval.info["failure"] != OK
        stretch, into = divmod(k - each, each)
        if stretch < 0:
            continue
        if into == each // 2:
            window, steps = Window(walks.machines), np.zeros(len(starts))
        if into >= each // 2:
            window.add(interval)
            steps[interval.running] += interval.info["steps"]
        if into == each - 1:
            stretches.append(_stretch(speeds[stretch], outcomes(fallen, steps > 0, window), window))
            if stretch + 1 < len(speeds):
                walks.command(speeds[stretch + 1])
    all_fell = [
        Stretch(speed, 0.0, 1.0, 0.0, math.nan, math.nan) for speed in speeds[len(stretches) :]
    ]
    return (*stretches, *all_fell)


def _stretch(command: float, outcomes: Sequence[str], window: Window) -> Stretch:
    walking = np.array([each == WALKS for each in outcomes])
    speed = cot = math.nan
    if walking.any():
        ledger, weighted = window.total(walking, window.machines[0])
        speed, cot = ledger.distance / ledger.time, weighted.cost_of_transport(window.machines[0])
    fallen, slipping = (float(np.isin(outcomes, kinds).mean()) for kinds in ((FALLS,), SLIPS))
    return Stretch(command, float(walking.mean()), fallen, slipping, speed, cot)


def commands_within(slowest: float, fastest: float) -> list[float]:
    """The commands at which a policy is evaluated that was trained for these (m/s).

    They are the multiples of `STEP` in the range; its ends, where it is too narrow to have one.
    """
    first, last = math.ceil(slowest / STEP - 1e-9), math.floor(fastest / STEP + 1e-9)
    return [round(n * STEP, 6) for n in range(first, last + 1)] or [slowest, fastest]


def _speeds(commands: Sequence[float]) -> list[float]:
    speeds = real_array("commands", commands)
    if speeds.ndim != 1 or not len(speeds):
        raise ValueError(f"commands = {commands!r}: give one or more speeds (m/s)")
    return [float(speed) for speed in speeds]
