"""Rolling out a policy from many starts side by side."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.policies import Floats, Policy
from rimless_gym.checks import real_array
from rimless_gym.energy import ROW
from rimless_gym.envs.observation import observe
from rimless_gym.envs.starts import draw_start
from rimless_gym.hybrid import OK
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from rimless_gym.params import WheelParams


class Interval(NamedTuple):
    """One control interval of N roll-outs; rows of those that have ended are left out.

    Attributes:
        running: indices (M,) of the roll-outs that had not ended before this interval.
        states: before the interval, (M, STATE_SIZE).
        observations: of these states, (M, 6).
        actions: voltage held, in units of the limit, (M,).
        rows: what the stepping kernel booked, (M, N_ROWS) of `rimless_gym.energy`.
        after: states after the interval, (M, STATE_SIZE).
    """

    running: NDArray[np.int64]
    states: Floats
    observations: NDArray[np.float32]
    actions: Floats
    rows: Floats
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


def rollout(
    params: WheelParams, policy: Policy, starts: Floats, n_intervals: int
) -> Iterator[Interval]:
    """Control intervals of a policy from `starts` (N, STATE_SIZE), each ending where it falls.

    Raises:
        TypeError: the policy gives no real numbers.
        ValueError: the policy gives NaN or the wrong shape.
    """
    state = np.array(starts, dtype=np.float64).reshape(-1, STATE_SIZE)
    running = np.arange(len(state))
    for _ in range(n_intervals):
        if len(running) == 0:
            return
        observations = observe(params, state)
        # Copies: a policy may well scale its inputs in place.
        actions = real_array("the policy's actions", policy(state.copy(), observations.copy()))
        actions = np.clip(actions, -1.0, 1.0)
        if actions.shape != (len(running),) or np.isnan(actions).any():
            raise ValueError(
                f"the policy gave shape {actions.shape} with {np.isnan(actions).sum()} NaN for "
                f"{len(running)} states: it must give one number in [-1, 1] for each"
            )
        after = state.copy()
        rows = advance(params, after, actions * params.voltage_limit)
        yield Interval(running, state, observations, actions, rows, after)
        going = rows[:, ROW.failure] == OK
        running, state = running[going], after[going]
