"""Smooth policies, their walks by the thousand in compiled code, and what these walks are worth.

**Policies.** An action is linear in products of what is observed, so it is smooth:

    a = clip(w . f(o), -1, 1)

f has a constant, the six numbers of the observation, two harmonics of the pendulum's angle, and
products of angles and rates: enough for a servo of the pendulum's rate with a bias, and for
corrections that depend on where the leg and the pendulum are.

**Walks.** The simulator is the environment's kernel, and every interval is the environment's: the
observation of the state, an action, its voltage held for 10 ms.

**Families.** A family of gaits is the number of revolutions that the pendulum makes per step,
forward or backward: 0 if it swings or leans. No small change of a policy leads from one family to
another, and a family in which walking is easy to find is rarely the cheapest.
"""

from __future__ import annotations

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.reward_weight import FEWEST_STEPS, NO_WALK, CleanWalking
from rimless_gym.energy import ROW
from rimless_gym.envs.layout import observation
from rimless_gym.envs.task import Task
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import cached, inner
from rimless_gym.kernel.stepping import (
    DPHI,
    DTHETA,
    MODE,
    PHI,
    THETA,
    advance_batch_at,
    kernel_address,
    machine_arrays,
    scratch,
)
from rimless_gym.kernel.tile import LANES
from rimless_gym.params import WheelParams
from rimless_gym.rules import LIMIT_TOLERANCE
from trajopt.feedback.law import Floats
from trajopt.pool import cores

EVOLUTION = "the walks of evolution (about 3 s)"

#: Most wheels that a thread walks with at a time.
MOST = 512

#: A walk belongs to a family if its revolutions per step differ by less than this.
WITHIN = 0.25

#: A wheel that lasted for at least this share of the time did not fall.
WHOLE = 1.0 - 1e-9


#: Numbers of a policy.
SIZE = 21


@inner
def features(leg, sine, cosine, leg_rate, rate, resting):  # type: ignore[no-untyped-def]
    """f (SIZE) of the observation's six numbers (`rimless_gym.envs.layout`)."""
    return (
        1.0,
        leg,
        sine,
        cosine,
        leg_rate,
        rate,
        resting,
        2.0 * sine * cosine,
        cosine * cosine - sine * sine,
        leg * sine,
        leg * cosine,
        leg_rate * sine,
        leg_rate * cosine,
        rate * sine,
        rate * cosine,
        leg * leg_rate,
        leg * rate,
        leg_rate * rate,
        leg * leg,
        rate * abs(rate),
        resting * sine,
    )


@inner
def action(weights, i, seen):  # type: ignore[no-untyped-def]
    """The action in [-1, 1] of policy i of `weights` (n, SIZE) for an observation."""
    products, total = features(*seen), 0.0
    for k in range(len(products)):
        total += weights[i, k] * products[k]
    return min(max(total, -1.0), 1.0)


def act(weights: Floats, observations: NDArray[np.float32]) -> Floats:
    """Actions (N,) of one policy (SIZE,) for observations (N, 6)."""
    actions = np.empty(len(observations))
    _act(weights.reshape(1, SIZE), observations.astype(np.float64), actions)
    return actions


@cached()
def _act(weights, observations, actions):  # type: ignore[no-untyped-def]
    for i in range(len(actions)):
        o = observations[i]
        actions[i] = action(weights, 0, (o[0], o[1], o[2], o[3], o[4], o[5]))


class PolicyWalks(NamedTuple):
    """Walks of P policies from S starts; every field has the shape (P, S).

    All but `lasted` are those of the window, the end of the walk; 0 where it was not reached.
    """

    lasted: Floats  # share of the whole time before a fall
    distance: Floats  # forward (m)
    energy: Floats  # electrical, without regeneration and idle energy (J)
    steps: Floats  # forward, less those backward
    turned: Floats  # by the pendulum (rad)
    slipping: Floats  # control intervals in which the foot would slip


#: Where each field of `PolicyWalks` is in the compiled results.
AT = PolicyWalks(*range(len(PolicyWalks._fields)))


class Duration(NamedTuple):
    """How long walks last."""

    intervals: int  # of control
    window: int  # the last of them, in which walking is measured

    @classmethod
    def second_half(cls, intervals: int) -> Duration:
        """Walks of so many intervals (at least 2), of which the first half is for getting going."""
        return cls(intervals, intervals // 2)


@dataclasses.dataclass(frozen=True)
class PolicySimulator:
    """Walks of many policies with one wheel."""

    params: WheelParams  # the wheel's parameters
    # that share the walks; the results do not depend on their number
    threads: int = dataclasses.field(default_factory=cores)

    def walk(self, weights: Floats, starts: Floats, duration: Duration) -> PolicyWalks:
        """Let policies (P, SIZE) walk from hybrid states (S, STATE_SIZE)."""
        n_policies, n_starts = len(weights), len(starts)
        assert weights.shape == (n_policies, SIZE)
        n = n_policies * n_starts
        results = np.zeros((len(PolicyWalks._fields), n))
        params, arrays = self.params, machine_arrays([self.params])
        slipping = params.friction * (1.0 + LIMIT_TOLERANCE)
        kernel = kernel_address()
        block = min(MOST, LANES * math.ceil(n / (LANES * self.threads)))

        def part(begin: int) -> None:
            which = np.arange(begin, min(begin + block, n))
            columns = np.ascontiguousarray(starts[which % n_starts].T)
            of_wheel = np.ascontiguousarray(weights[which // n_starts])
            results[:, which] = _walk(
                *(columns, of_wheel, duration.intervals, duration.window),
                *(params.voltage_limit, 2.0 / params.leg_angle, slipping, *arrays, scratch()),
                kernel,
            )

        with ThreadPoolExecutor(self.threads) as threads:
            list(threads.map(part, range(0, n, block)))
        return PolicyWalks(*results.reshape(-1, n_policies, n_starts))


@cached(EVOLUTION, nogil=True)
def _walk(  # type: ignore[no-untyped-def]
    states, weights, intervals, window, limit, leg_scale, slipping, constants, poles, work, kernel
):
    n = states.shape[1]
    totals = np.zeros((len(AT), n))
    out, volts, begun = np.empty((len(ROW), n)), np.empty(n), np.zeros(n)
    wheel, count = np.arange(n), n
    for t in range(intervals):
        for i in range(count):
            seen = observation(
                *(states[PHI, i], states[THETA, i], states[DPHI, i], states[DTHETA, i]),
                *(states[MODE, i], leg_scale),
            )
            volts[i] = limit * action(weights, wheel[i], seen)
            if t == intervals - window:
                begun[wheel[i]] = states[THETA, i]
        advance_batch_at(
            kernel,
            (
                *(constants, poles, states, volts, np.int64(0), count),
                *(CONTROL_PERIOD, 0.0, out, work),
            ),
        )
        for i in range(count - 1, -1, -1):
            w = wheel[i]
            demand = max(out[ROW.friction_demand, i], out[ROW.impulse_friction_demand, i])
            if out[ROW.failure, i] != 0.0:  # the last wheel that still walks takes its place
                count -= 1
                wheel[i] = wheel[count]
                states[:, i] = states[:, count]
                continue
            totals[AT.lasted, w] += 1.0 / intervals
            if t >= intervals - window:
                totals[AT.distance, w] += out[ROW.distance, i]
                totals[AT.energy, w] += out[ROW.electrical_positive, i]
                totals[AT.steps, w] += out[ROW.steps, i]
                totals[AT.turned, w] = states[THETA, i] - begun[w]
                totals[AT.slipping, w] += 1.0 if demand > slipping else 0.0
    return totals


@dataclasses.dataclass(frozen=True)
class WalkReward:
    """What is rewarded."""

    params: WheelParams  # the wheel's parameters
    task: Task  # whose penalties for slips and falls apply
    speed: float  # up to which distance is rewarded (m/s)

    def scores(
        self,
        walks: PolicyWalks,
        duration: Duration,
        family: float,
        distance_weight: float,
        counted: float = 1.0,
    ) -> Floats:
        """The mean reward (P,) of policies per second (m/s), with a weight of distance.

        It is the reward of the window, as a cost of transport is that of a steady walk: the energy
        to get there is several times that of the gait, and would hide it. The penalty for a fall is
        up to twice that of the task, the more the earlier it is. Distance in another family's gait
        is not rewarded. Only each policy's best starts count: a share `counted`, at least one.
        """
        time = duration.window * CONTROL_PERIOD
        idle = self.params.idle_power * duration.window * CONTROL_PERIOD
        energy = walks.energy / self.params.weight + idle / self.params.weight
        off = np.abs(revolutions(walks) - family)
        share = np.where(walks.steps >= FEWEST_STEPS, np.clip(1.5 - 2.0 * off, 0.0, 1.0), 1.0)
        distance = np.minimum(walks.distance, self.speed * time)
        distance = np.where(distance > 0.0, share * distance, distance)
        slipped = self.task.slip_penalty * CONTROL_PERIOD * walks.slipping
        fallen = self.task.fall_penalty * (walks.lasted < WHOLE) * (2.0 - walks.lasted)
        rewards = distance_weight * (distance - slipped - fallen) - energy
        count = max(1, round(counted * rewards.shape[1]))
        return np.asarray(np.sort(rewards, axis=1)[:, -count:].mean(axis=1) / time)

    def gait(self, walks: PolicyWalks, duration: Duration, family: float) -> CleanWalking:
        """How the first policy of some walks walks in its family's gait."""
        fits = members(walks, family)[0] & (walks.slipping[0] == 0.0)
        if not fits.any():
            return NO_WALK
        time = duration.window * CONTROL_PERIOD * fits.sum()
        distance = walks.distance[0][fits].sum()
        energy = walks.energy[0][fits].sum() + self.params.idle_power * time
        return CleanWalking(
            float(fits.mean()),
            float(energy / (self.params.weight * distance)) if distance > 0.0 else np.inf,
            float(distance / time),
        )


def stepping(walks: PolicyWalks) -> NDArray[np.bool_]:
    """Whether the wheels still take steps forward at the end, (P, S)."""
    return (walks.lasted > WHOLE) & (walks.steps >= FEWEST_STEPS)


def members(walks: PolicyWalks, family: float) -> NDArray[np.bool_]:
    """Which wheels walk in a family's gait, (P, S)."""
    return stepping(walks) & (np.abs(revolutions(walks) - family) < WITHIN)


def revolutions(walks: PolicyWalks) -> Floats:
    """Revolutions of the pendulum per step in the window, (P, S)."""
    return np.asarray(walks.turned / (2.0 * np.pi) / np.maximum(walks.steps, 1.0))


def senses(walks: PolicyWalks) -> NDArray[np.int64]:
    """In which sense pendulums go round in the window of wheels that do not fall, (P, S).

    -1 forward, 1 backward, 0 for those that turn by less than half a revolution.
    """
    goes_round = (np.abs(walks.turned) > np.pi) & (walks.lasted > WHOLE)
    return np.asarray(np.where(goes_round, np.sign(walks.turned), 0.0), dtype=np.int64)


def families(walks: PolicyWalks) -> NDArray[np.int64]:
    """The families in which some wheel walks, fewest revolutions first."""
    rounded = np.unique(np.round(revolutions(walks))[stepping(walks)])
    walked = [family for family in rounded.tolist() if members(walks, family).any()]
    return np.asarray(sorted(walked, key=lambda family: (abs(family), family)), dtype=np.int64)
