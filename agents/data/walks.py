"""What a dataset holds: the walks of one walker, or of the optimal gaits."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agents.baselines import walker_or_baseline
from agents.conditions import Conditions
from agents.episodes import Episode, episodes
from agents.policies import Policy
from agents.policy_files import PRETRAINED
from rimless_gym.envs.task import TERM_NAMES
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import THETA
from rimless_gym.params import WheelParams
from trajopt import NoGaitError
from trajopt.feedback import laws
from trajopt.feedback.law import Floats
from trajopt.gaits.fronts import cot_front
from trajopt.gaits.solution import Solution

#: The dataset of optimal gaits.
OPTIMAL = "optimal"

#: Speeds of its gaits (m/s); each is that nearest at which a step is a whole number of intervals.
SPEEDS = (0.4, 0.45, 0.5, 0.53, 0.56, 0.58, 0.6, 0.62, 0.635)

#: Most steps of an episode on a gait. Nothing holds it: rounding grows in each stride.
MOST_STEPS = 500

#: How far such an episode may be from the gait (rad, rad/s) before it has to end.
FAITHFUL = 1e-6

#: Entries of `info` that are stored: the terms of the reward, and what a CoT needs.
KEPT = (*TERM_NAMES, "distance", "electrical_positive", "idle")

GaitFor = Callable[[WheelParams], Solution]


@dataclasses.dataclass(frozen=True)
class Walks:
    """Episodes of a dataset.

    Attributes:
        made: what walks, in words.
        conditions: machine and control.
        steps: after which episodes are truncated.
        episodes: that were walked.
    """

    made: str
    conditions: Conditions
    steps: int
    episodes: list[Episode]


def walks_of(
    name: str, params: WheelParams | None, gait_for: GaitFor, count: int, seed: int
) -> Walks:
    """Episodes of a walker from the environment's own starts.

    Args:
        name: of a baseline, a law or a policy, or a policy's file.
        params: the machine; None: a policy's own, and BUILDABLE for others.
        gait_for: finds the gait that a law is to hold.
        count: episodes; episode i begins with `reset(seed=seed + i)`.
        seed: see `count`; random voltages follow it too.

    Raises:
        CheckpointError, NoGaitError: see `agents.walkers.walker`.
    """
    found = walker_or_baseline(name, gait_for, params, seed)
    steps = found.conditions.control.episode_steps
    envs = found.conditions.envs(count, max_episode_steps=steps)
    walked = episodes(envs, found.policy, seed, keep=KEPT, progress=name)
    made = f"the policy `{Path(name).stem}`"
    if found.gait is not None:
        made = f"the feedback law `{name}` about the optimal gait at {found.gait.speed:.3f} m/s"
    elif found.task is None:
        made = f"the baseline `{name}`"
    elif name in PRETRAINED:
        made += ", which comes with the package"
    return Walks(made, found.conditions, steps, walked)


def optimal_walks(
    params: WheelParams, folder: Path, seed: int, speeds: Sequence[float] = SPEEDS
) -> Walks:
    """An episode on each of some optimal gaits, its voltages repeated stride after stride.

    Args:
        params: the machine.
        folder: where gaits are kept that were solved.
        seed: of the first episode; what is drawn from it changes nothing.
        speeds: of the gaits (m/s).

    Raises:
        NoGaitError: none was found.
    """
    front = cot_front(params, speeds, [1], hold=CONTROL_PERIOD, folder=folder, progress=True)
    conditions = Conditions(params)
    steps = min(faithful_steps(gait) for gait in front.envelope)
    if not steps:
        raise NoGaitError("no gait repeats itself in the environment for even one stride")
    walked = [
        one
        for i, gait in enumerate(front.envelope)
        for one in episodes(
            conditions.envs(1, max_episode_steps=steps),
            played(gait),
            seed + i,
            options=beginning(gait),
            keep=KEPT,
        )
    ]
    told = ", ".join(f"{gait.speed:.3f}" for gait in front.envelope)
    made = f"optimal gaits at {told} m/s, their voltages held for 10 ms and repeated in open loop"
    return Walks(made, conditions, steps, walked)


def beginning(gait: Solution) -> dict[str, list[float]]:
    """Options of `reset` with which an episode begins on a held gait, at its first tick."""
    return {"state": gait.state(gait.first_tick).tolist()}


def played(gait: Solution) -> Policy:
    """The voltages of a held gait from its first tick on, whatever the state."""
    actions, tick = gait.held_voltages / gait.params.voltage_limit, 0

    def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
        nonlocal tick
        tick += 1
        return np.full(len(states), actions[(tick - 1) % len(actions)])

    return policy


def faithful_steps(gait: Solution) -> int:
    """How many steps, whole strides or `MOST_STEPS`, a gait repeats within `FAITHFUL`."""
    envs, policy = Conditions(gait.params).envs(1, max_episode_steps=None), played(gait)
    observations, _ = envs.reset(options=beginning(gait))
    ticks, states = len(gait.held_voltages), [envs.states[0]]
    for step in range(1, MOST_STEPS + 1):
        action = policy(envs.states, observations)
        observations, _, fell, _, _ = envs.step(action[:, None].astype(np.float32))
        states.append(envs.states[0])
        if fell[0] or (step >= ticks and _apart(states[-1], states[-1 - ticks]) > FAITHFUL):
            return (step - 1) // ticks * ticks
    return MOST_STEPS


def _apart(state: Floats, other: Floats) -> float:
    """The largest difference of two states in angle (turns left out) or rate."""
    difference = (state - other)[:4]
    difference[THETA] = (difference[THETA] + np.pi) % (2 * np.pi) - np.pi
    return float(np.abs(difference).max())


def standard() -> tuple[str, ...]:
    """Everything of which datasets are written unless others are named: what walks fast enough."""
    fast = (name for name in laws.names() if name not in laws.SLOW)
    return (OPTIMAL, "random", *fast, *PRETRAINED)
