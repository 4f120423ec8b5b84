"""Walks beside the optimal cycle: their deviations from it, and their return maps.

A return map plots how fast the leg comes down, step after step, after small pushes. A walk repeats
itself where the points meet the diagonal. The multipliers are the factors by which small deviations
grow or shrink in a step, in the loop that the policy and its clock close.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from agents.conditions import Conditions
from agents.policies import Policy
from agents.rollout import Interval, Rollout
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import DPHI, MODE, PHI, THETA, advance
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Floats
from trajopt.gaits.solution import Solution

#: Walks that are pushed, the size of a push in standard deviations of the walk, and steps drawn.
PUSHED, PUSH, STEPS = 24, 0.01, 10

#: Size of the deviations that are followed, in the same unit. Networks have single precision.
SMALL = 1e-4

#: A coordinate with a smaller standard deviation stands still.
STILL = 1e-6

#: Steps over which multipliers are averaged, after some in which the deviations find their
#: directions.
AVERAGED, FINDING = 30, 4

#: A direction whose signs have a larger mean than this does not turn.
STEADY_SIDE = 0.8

#: Pushed walks are shown as far out as this share of their points (%).
SHOWN = 98

#: Longest step (s).
LONGEST = 2.0

#: So long before a touchdown the leg's rate is read (s).
BEFORE = 1e-9


class Multiplier(NamedTuple):
    """By how much a small deviation grows in a step.

    Attributes:
        size: less than 1 where it shrinks.
        sign: 1, or -1 where it changes sides with every step; 0 where its direction turns.
    """

    size: float
    sign: int


class ReturnMap(NamedTuple):
    """The touchdowns of pushed walks.

    Attributes:
        rates: of the leg just before each touchdown (rad/s), (PUSHED, STEPS); NaN after a fall.
        steady: the same without a push, the mean over the last steps (rad/s).
        multipliers: see `multipliers`; None if the walk does not go on.
    """

    rates: Floats
    steady: float
    multipliers: Sequence[Multiplier] | None

    @property
    def spread(self) -> float:
        """How far from the steady rate most touchdowns are (rad/s); 0 where there are none."""
        away = np.abs(self.rates - self.steady)
        return float(np.percentile(away[~np.isnan(away)], SHOWN)) if np.any(away >= 0.0) else 0.0


def return_map(params: WheelParams, policy: Policy, walk: Sequence[Interval]) -> ReturnMap:
    """The return map of a policy about its steady walk.

    Args:
        params: the machine.
        policy: decides every 10 ms.
        walk: of the policy, until it is steady.

    Raises:
        ValueError: the walk has no step in its last two seconds.
    """
    begin = last_middle(walk)
    if begin is None:
        raise ValueError(f"no step in the last {LONGEST:g} s of the walk: it does not walk")
    scale = np.std([interval.states[0, :MODE] for interval in walk[len(walk) // 2 :]], axis=0)
    scale[scale < STILL] = 1.0
    scale[THETA] = 1.0  # it turns: its standard deviation means nothing
    rng = np.random.default_rng(0)
    starts = np.tile(begin, (PUSHED, 1))
    starts[:, :MODE] += PUSH * scale * rng.standard_normal((PUSHED, MODE))
    pushed = touchdown_rates(params, policy, starts, STEPS)
    steady = touchdown_rates(params, policy, begin[None], STEPS)
    return ReturnMap(pushed, float(np.nanmean(steady)), multipliers(params, policy, begin, scale))


def last_middle(walk: Sequence[Interval]) -> Floats | None:
    """The state in the middle of a walk's last step; None if it takes none in its last seconds."""
    late = walk[-round(LONGEST / CONTROL_PERIOD) :]
    return next((each.after[0] for each in reversed(late) if _at_middle(each)), None)


def touchdown_rates(params: WheelParams, policy: Policy, starts: Floats, steps: int) -> Floats:
    """The leg's rate (rad/s) just before each of the first touchdowns of some walks.

    Args:
        params: the machine.
        policy: decides every 10 ms.
        starts: (N, STATE_SIZE).
        steps: touchdowns.

    Returns:
        Shape (N, steps), NaN after a fall.
    """
    rates = np.full((len(starts), steps), np.nan)
    seen = np.zeros(len(starts), dtype=int)
    n_intervals = math.ceil(steps * LONGEST / CONTROL_PERIOD)
    for interval in Rollout(Conditions(params), policy, starts, n_intervals):
        for j in np.flatnonzero(interval.info["steps"] > 0):
            row = interval.running[j]
            if seen[row] < steps:
                rates[row, seen[row]] = _rate(params, interval, int(j))
                seen[row] += 1
        if (seen[interval.running] >= steps).all():
            break
    return rates


def _rate(params: WheelParams, interval: Interval, j: int) -> float:
    """Rate of the leg just before the touchdown in an interval of walk j (rad/s)."""
    state = interval.states[j : j + 1].copy()
    until = float(interval.info["touchdown_time"][j]) - BEFORE
    if until > 0.0:
        advance(params, state, params.voltage_limit * interval.actions[j : j + 1], until)
    return float(state[0, DPHI])


def multipliers(
    params: WheelParams, policy: Policy, start: Floats, scale: Floats
) -> list[Multiplier] | None:
    """By how much small deviations from a walk grow in a step, largest first, four of them.

    Four deviations are followed from one middle of a step to the next, and made small and
    perpendicular again there (Benettin et al., Meccanica 15, 1980). In a walk that repeats itself
    these are its Floquet multipliers. In one that drifts through the ticks of the control, the
    largest is 1.

    Args:
        params: the machine.
        policy: decides every 10 ms.
        start: state in the middle of a step, (STATE_SIZE,).
        scale: unit of each coordinate, (4,).

    Returns:
        None if a walk falls or stops.
    """
    frame, sizes, signs = np.eye(MODE), list[Floats](), list[Floats]()
    for _ in range(FINDING + AVERAGED):
        nudges = np.zeros((2 * MODE + 1, len(start)))
        nudges[1 : MODE + 1, :MODE] = SMALL * scale * frame.T
        nudges[MODE + 1 :] = -nudges[1 : MODE + 1]
        ends = _a_step_later(params, policy, start + nudges)
        if ends is None:
            return None
        start = ends[0]
        moved = ((ends[1 : MODE + 1, :MODE] - ends[MODE + 1 :, :MODE]) / (2 * SMALL * scale)).T
        signs.append(np.sign(np.sum(frame * moved, axis=0)))
        frame, grown = np.linalg.qr(moved)
        sizes.append(np.maximum(np.abs(np.diag(grown)), np.finfo(float).tiny))
    growth = np.exp(np.mean(np.log(sizes[FINDING:]), axis=0))
    side = np.mean(signs[FINDING:], axis=0)
    sides = np.where(np.abs(side) > STEADY_SIDE, np.sign(side), 0.0)
    growths = [Multiplier(float(size), int(sign)) for size, sign in zip(growth, sides, strict=True)]
    return sorted(growths, key=lambda each: -each.size)


def _a_step_later(params: WheelParams, policy: Policy, starts: Floats) -> Floats | None:
    """States when the first walk is in the middle of its next step; None if one does not come."""
    walks = Rollout(Conditions(params), policy, starts, round(LONGEST / CONTROL_PERIOD))
    stepped = False
    for interval in walks:
        if len(interval.running) < len(starts):
            return None
        stepped = stepped or interval.info["steps"][0] > 0
        if stepped and _at_middle(interval):
            return interval.after
    return None


def _at_middle(interval: Interval) -> bool:
    """Whether the first walk's leg passes the vertical in an interval."""
    before, after = interval.states[0, PHI], interval.after[0, PHI]
    upright = (before - math.pi / 2) * (after - math.pi / 2) <= 0.0
    # Out of double stance the stance leg may change without a touchdown, as a step of -1.
    changes = interval.info["touchdowns"][0] != 0 or interval.info["steps"][0] != 0
    return bool(upright and not changes)


def multipliers_text(multipliers_: Sequence[Multiplier]) -> str:
    """Multipliers in words."""
    texts = [
        f"{each.size:.2f} (turning)" if each.sign == 0 else f"{each.sign * each.size:.2f}"
        for each in multipliers_
    ]
    return "multipliers " + ", ".join(texts)


class WalkedStep(NamedTuple):
    """A walk from one touchdown to the next, or its deviation from the step of a gait.

    Attributes:
        phases: shares of the step's time at the ticks of the control within it, (K,).
        states: there, (K, 4).
    """

    phases: Floats
    states: Floats


def steps_of(walk: Iterable[Interval]) -> list[WalkedStep]:
    """The steps of the first of some walks, from its first touchdown to its last."""
    steps: list[WalkedStep] = []
    begin, times, states = None, list[float](), list[Floats]()
    for k, interval in enumerate(walk):
        if len(interval.running) == 0 or interval.running[0] != 0:
            break
        times.append(k * CONTROL_PERIOD)
        states.append(interval.states[0, :MODE])
        if interval.info["steps"][0] <= 0:
            continue
        end = times[-1] + float(interval.info["touchdown_time"][0])
        if begin is not None:
            phases = (np.array(times) - begin) / (end - begin)
            steps.append(WalkedStep(phases, np.array(states)))
        begin, times, states = end, [], []
    return steps


def deviations(steps: Sequence[WalkedStep], gait: Solution) -> list[WalkedStep]:
    """Deviations of consecutive steps from those of a gait, at equal shares of a step's time.

    Where the gait has several steps in a stride, the walk's first step is compared with the one
    that makes its deviations the smallest.
    """
    scale = gait.state(np.linspace(0.0, gait.duration, 200)).std(axis=0)
    candidates = [_deviations_from(steps, gait, first) for first in range(gait.steps)]

    def size(candidate: list[WalkedStep]) -> float:
        return sum(float(np.sum((each.states / scale) ** 2)) for each in candidate)

    return min(candidates, key=size)


def _deviations_from(steps: Sequence[WalkedStep], gait: Solution, first: int) -> list[WalkedStep]:
    deviations_ = []
    for i, step in enumerate(steps):
        phase = gait.phases[(first + i) % gait.steps]
        difference = step.states - phase.state(step.phases * phase.duration)
        whole_turns = np.round(difference[:, THETA] / (2 * np.pi))
        difference[:, THETA] -= 2 * np.pi * whole_turns
        deviations_.append(WalkedStep(step.phases, difference))
    return deviations_
