"""What can be imitated: feedback laws, gain schedules of them, and learned policies in files.

A learned policy may be imitated near its own gait alone. Elsewhere the start-up controller of that
gait is imitated, which needs the simulator but no feedback law.

A feedback law holds one gait. A gain schedule has one law for every speed at which two steps last a
whole number of control intervals. Near one of its gaits, of the laws whose gaits are within reach
the one nearest to the commanded speed acts, so that a change of command is followed step by step: a
law that is far from its gait may lose the foot, or slip. Elsewhere the fastest law acts, whatever
the command: so there is one start-up to imitate, not one for each law. A network that imitates the
schedule fills in the speeds between its laws.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.conditions import Conditions
from agents.learner import DoesNotWalkError
from agents.outcomes import WALKS, WindowTotals, outcomes
from agents.policy_files import Checkpoint, CheckpointError, load_policy
from agents.rollout import (
    Interval,
    Policy,
    Rollout,
    Running,
    controller_policy,
    draw_starts,
    true_state_policy,
)
from rimless_gym.envs.layout import commanded_speeds
from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import FOOT, MODE
from rimless_gym.params import WheelParams
from trajopt import Solution, periodic_gait
from trajopt.feedback import laws
from trajopt.feedback.adaptive import AdaptiveController
from trajopt.feedback.controller import NEAR, ContactGuard, margin_for
from trajopt.feedback.law import Controller, Floats
from trajopt.feedback.orbit import TURNING_WEIGHT, Orbit, squared_distances
from trajopt.feedback.startup import Weights, lost_return, near_for, startup_for
from trajopt.gaits.fronts import Wanted, cot_front, solved
from trajopt.gaits.held_stride import held_speeds
from trajopt.gaits.library import repeated
from trajopt.pool import announce, progress_bar

#: What is imitated by default: a feedback law, and the gait that it holds.
EXPERT, EXPERT_SPEED, EXPERT_STEPS = "lqr", 0.62, 1

#: Distance from its gait up to which a law is within reach on the way to another speed, in standard
#: deviations of the gait's own motion. It is well within `NEAR`, where laws act themselves and not
#: their start-up controllers. With 0.1, walks slip on the way from the gait of 0.52 m/s to that of
#: 0.62.
WITHIN_REACH = 0.06


#: A policy's own gait is that of the last seconds of a long walk, from one of so many starts.
LONG, RECORDED, RECORDED_STARTS = 40.0, 5.0, 64

#: Distance from its gait at which a policy has no share of the voltage any more; the start-up
#: controller has none up to `near_for`. A network cannot imitate a switch near the gait: gaits that
#: are only just stable would be lost.
FAR = 0.5

#: Nodes per control period in the table of such a gait, on straight lines between its states.
#: `trajopt.feedback.orbit.located` searches one node in `SKIPPED`, and those around the nearest.
NODES = 8


def expert_policy(
    expert: Controller | OwnLaws | str,
    conditions: Conditions,
    cache: Path | None = None,
    progress: bool = True,
    *,
    startup: bool = False,
) -> Policy:
    """The policy to imitate.

    Args:
        expert: a feedback law; or `OwnLaws`; or the name of a law, about the optimal gait at
            `EXPERT_SPEED` whose voltage is held as in the environment, or scheduled over all
            commanded speeds; or a policy's file.
        conditions: of the training.
        cache: folder of gaits and plans that other trainings use too.
        progress: whether to show progress on a terminal.
        startup: whether a policy in a file acts near its own gait only; see `with_startup`.

    Raises:
        CheckpointError: it is neither, or the policy is for another wheel or control.
        DoesNotWalkError: `startup` for a policy that does not walk.
    """
    params, period = conditions.params, conditions.control.period
    if isinstance(expert, OwnLaws):
        return expert
    if not isinstance(expert, str):
        return controller_policy(params, expert)
    if expert not in laws.names():
        policy = true_state_policy(params, fitting_policy(expert, conditions).act)
        return with_startup(policy, conditions, cache, progress) if startup else policy
    if progress:
        announce(f"designing {expert} and its start-up controller (up to a minute)")
    if conditions.commanded:
        return gain_schedule(expert, conditions, cache, progress)
    gait = periodic_gait(params, EXPERT_SPEED, EXPERT_STEPS, hold=period, progress=progress)
    return controller_policy(params, laws.design(expert, gait, cache))


def fitting_policy(path: str, conditions: Conditions) -> Checkpoint:
    """The policy in a file, if it observes and decides as these conditions say.

    Raises:
        CheckpointError: it is missing or damaged, or for another wheel or control.
    """
    policy = load_policy(path, conditions.params)
    if policy.conditions.commanded != conditions.commanded:
        how = ("without", "with")[policy.conditions.commanded]
        raise CheckpointError(
            f"{path}: a policy that walks {how} a commanded speed; train {how} speeds "
            "(--speeds), or give another policy"
        )
    period, wanted = policy.conditions.control.period, conditions.control.period
    if period != wanted:
        raise CheckpointError(
            f"{path}: a policy that decides every {period:g} s, not every {wanted:g} s; train with "
            "its control period (--control-period), or give another policy"
        )
    return policy


def with_startup(
    policy: Policy, conditions: Conditions, cache: Path | None = None, progress: bool = True
) -> Policy:
    """A policy near its own gait, and far from it the start-up controller that leads there.

    In between, the voltage is a mean of both.

    Args:
        policy: that walks, on the nominal machine without disturbances.
        conditions: machine and control period; no speed is commanded.
        cache: folder in which the start-up controller is cached.
        progress: whether to show progress on a terminal.

    Raises:
        DoesNotWalkError: the policy does not walk.
    """
    if progress:
        announce("computing the start-up controller of the expert's gait (half a minute)")
    params = conditions.params
    orbit, weights = walked_gait(policy, Conditions(params, control=conditions.control))
    near = near_for(params, orbit)
    far = max(FAR, 2.0 * near)
    startup = startup_for(params, orbit, near, weights, cache)

    def blended(states: Floats, observations: NDArray[np.float32]) -> Floats:
        modes, smooth = states[:, MODE].astype(np.int64), np.ascontiguousarray(states[:, :4])
        away = np.sqrt(squared_distances(smooth, orbit))
        away[modes != SINGLE] = far
        share = np.clip((away - near) / (far - near), 0.0, 1.0)  # of the start-up controller
        actions, some = policy(states, observations), share > 0.0
        led = startup(smooth[some], modes[some]) / params.voltage_limit
        actions[some] += share[some] * (led - actions[some])
        return actions

    return blended


def walked_gait(policy: Policy, conditions: Conditions) -> tuple[Orbit, Weights]:
    """The orbit of the gait into which a policy settles, and the weights of a start-up to it.

    The gait is that of the walk whose cost of transport is the median one.

    Args:
        policy: that walks.
        conditions: machine and control period.

    Returns:
        The orbit, whose nodes are in single stance, along several strides; and the weights by
        which a start-up costs what it loses of the return on the gait.

    Raises:
        DoesNotWalkError: the policy does not walk.
    """
    params, period = conditions.params, conditions.control.period
    n, n_recorded = round(LONG / period), round(RECORDED / period)
    starts = draw_starts(params, RECORDED_STARTS, 0)
    rollout, recorded = Rollout(conditions, policy, starts, n), list[Interval]()
    window, steps = WindowTotals(rollout.machines), np.zeros(len(starts))
    for k, interval in enumerate(rollout):
        if k >= n - n_recorded:
            recorded.append(interval)
            window.add(interval)
            steps[interval.running] += interval.info["steps"]
    fallen = ~np.isin(np.arange(len(starts)), rollout.running)
    walking = np.flatnonzero(np.array(outcomes(fallen, steps > 0, window)) == WALKS)
    if not len(walking):
        raise DoesNotWalkError(
            f"expert: still walks after {LONG:g} s from none of {len(starts)} starts, so it has no "
            "gait to start up to; take one that walks, or leave out startup"
        )
    ledgers = window.ledgers()
    walking = walking[np.argsort([ledgers[i].cost_of_transport(params) for i in walking])]
    median = walking[len(walking) // 2]
    states = np.concatenate([each.states[each.running == median] for each in recorded])
    single = states[:, MODE] == SINGLE
    same_foot = np.diff(states[:, FOOT], append=np.nan) == 0.0
    continued = single & np.append(single[1:], False) & same_foot
    smooth = states[:, :4].copy()
    smooth[:, 1] = np.unwrap(smooth[:, 1])
    metric = 1.0 / np.var(smooth[single], axis=0)
    if abs(smooth[-1, 1] - smooth[0, 1]) > 2 * np.pi:  # the pendulum turns over
        metric[1] = TURNING_WEIGHT
    # (ticks, NODES): evenly spaced up to the next tick of a step, one node at its last tick
    shares = np.arange(NODES) / NODES
    some = single[:, None] & (continued[:, None] | (shares == 0.0))
    ahead = np.diff(smooth, axis=0, append=smooth[-1:])
    nodes = np.ascontiguousarray((smooth[:, None] + shares[:, None] * ahead[:, None])[some])
    orbit = Orbit(
        nodes,
        (period * (np.arange(len(states))[:, None] + shares))[some],
        np.zeros(len(nodes)),  # a policy's voltages are its own
        np.broadcast_to(continued[:, None], some.shape)[some],
        metric,
        params.voltage_limit,
    )
    ledger = ledgers[median]
    speed, cot = ledger.distance / ledger.time, ledger.cost_of_transport(params)
    return orbit, lost_return(params, speed, cot)


#: At how many states the distance between two gaits is measured.
COMPARED = 32


@dataclasses.dataclass(frozen=True)
class OwnLaws:
    """A policy that knows the machine of each walk, and holds the gait that suits it.

    What imitates it has to do with the state alone. Where machines are drawn, it learns to ask
    less of those whose own gait is another, and so costs less than a law about the nominal gait.

    Attributes:
        controller: whose table has the laws.
    """

    controller: AdaptiveController

    def begin(self, machines: Sequence[WheelParams], running: Running) -> Policy:
        """See `agents.rollout.begun`."""
        own = lru_cache(None)(lambda row: self.controller_for(machines[row]))

        def policy(states: Floats, observations: NDArray[np.float32]) -> Floats:
            rows, actions = running(), np.empty(len(states))
            for row in np.unique(rows):
                these = rows == row
                modes = states[these, MODE].astype(np.int64)
                volts = own(int(row))(states[these, :4], modes)
                actions[these] = volts / machines[row].voltage_limit
            return actions

        return policy

    def __call__(self, states: Floats, observations: NDArray[np.float32]) -> Floats:
        """The actions (N,) in [-1, 1] for the nominal machine."""
        machines = (self.controller.params,)
        return self.begin(machines, lambda: np.zeros(len(states), np.int64))(states, observations)

    def controller_for(self, machine: WheelParams) -> Controller:
        """A machine's own law, which acts from farther away: by as much as the gaits are apart.

        What imitates it walks about the nominal gait at first. Labels of the start-up there, which
        the machine does not need, would cost the clone a fifth of its energy.
        """
        controller, gait = self.controller, self.controller.table.gait
        if not controller.table.has(machine.slope):
            return controller.controller_for(machine)
        law, places = controller.law_of(machine), (np.arange(COMPARED) + 0.5) / COMPARED
        states = np.ascontiguousarray(gait.state(gait.duration * places))
        apart = float(np.sqrt(squared_distances(states, law.data.orbit)).max())
        farther = dataclasses.replace(law, reach=1.0 + apart / controller.near)
        return controller.with_startup(farther)


class ScheduledLaw(NamedTuple):
    """A policy that holds a gait of some speed (m/s), whose orbit it reaches from everywhere."""

    speed: float
    policy: Policy
    orbit: Orbit


@dataclasses.dataclass(frozen=True)
class GainSchedule:
    """A policy that follows commanded speeds, by one or more laws of rising speed."""

    laws: tuple[ScheduledLaw, ...]

    @property
    def speeds(self) -> Floats:
        """Speeds of the laws (m/s), (K,)."""
        return np.array([law.speed for law in self.laws])

    def __call__(self, states: Floats, observations: NDArray[np.float32]) -> Floats:
        """Actions (N,) for states (N, STATE_SIZE) and observations (N, 8)."""
        commands = commanded_speeds(observations)
        wanted = np.abs(commands[:, None] - self.speeds).argmin(axis=1)
        acting = self._towards(wanted, states)
        actions = np.empty(len(states))
        for k in np.unique(acting):
            rows = acting == k
            actions[rows] = self.laws[k].policy(states[rows], observations[rows])
        return actions

    def _towards(self, wanted: NDArray[np.int64], states: Floats) -> NDArray[np.int64]:
        """The laws (N,) that act: on the way to those that are wanted, (N,)."""
        smooth = np.ascontiguousarray(states[:, :4])
        away = np.stack([squared_distances(smooth, law.orbit) for law in self.laws], axis=1)
        walking = (away.min(axis=1) <= NEAR**2) & (states[:, MODE] == SINGLE)
        left = np.abs(np.arange(len(self.laws)) - wanted[:, None]).astype(np.float64)
        left[away > WITHIN_REACH**2] = np.inf
        towards = np.where(np.isfinite(left.min(axis=1)), left.argmin(axis=1), away.argmin(axis=1))
        return np.where(walking, towards, len(self.laws) - 1)


def gain_schedule(
    name: str,
    conditions: Conditions,
    cache: Path | None = None,
    progress: bool = True,
) -> GainSchedule:
    """Feedback laws about the most efficient held gaits of one step, for commanded speeds.

    Where a step lasts half an interval more than whole ones, the gait has two steps, which are
    nearly alike. Other schedules use the folder `cache` of gaits and plans too.

    Raises:
        NoGaitError: there is no gait at any of the speeds.
    """
    assert conditions.control.speeds is not None
    if cache is not None:
        cache.mkdir(parents=True, exist_ok=True)
    period, params = conditions.control.period, conditions.params
    slowest, fastest = conditions.control.speeds
    # the fastest law also starts up: none is faster than all commands
    held = held_speeds(params, slowest, fastest, period)
    speeds = [speed for speed in held if speed <= fastest] or held
    front = cot_front(params, speeds, [EXPERT_STEPS], hold=period, folder=cache, progress=progress)
    scheduled = []
    gaits = progress_bar("laws", progress, iterable=front.envelope, unit="gait", leave=False)
    for one_step in gaits:
        for gait in (one_step, *_halfway(one_step, fastest, cache)):
            law = laws.holding(name, gait)
            # so near its gait a law acts by itself
            policy = controller_policy(params, ContactGuard(params, law, margin_for(gait)))
            scheduled.append(ScheduledLaw(gait.speed, policy, law.data.orbit))
    startup = controller_policy(params, laws.design(law, gait, cache))
    return GainSchedule((*scheduled[:-1], scheduled[-1]._replace(policy=startup)))


def _halfway(gait: Solution, fastest: float, cache: Path | None) -> tuple[Solution, ...]:
    """The gait of two steps that last half a period less than another's one, up to a speed."""
    params, hold = gait.params, gait.hold
    assert hold is not None
    speed = params.step_length / (gait.duration - hold / 2)
    if speed > fastest:
        return ()
    found = solved(Wanted(params, speed, 2, False, hold), [repeated(gait, 2)], cache)
    return () if isinstance(found, str) else (found,)
