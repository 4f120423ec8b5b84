"""Random numbers for compiled code: a stream for each row, and the rough ground of an episode.

A stream is splitmix64: a 64-bit counter, mixed. Its numbers do not depend on other streams.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rimless_gym.jit import cached, inner

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MIX1, _MIX2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S27, _S30, _S31, _S11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)


@inner
def _mixed(counter):
    """The number in [0, 1) of a counter (uint64)."""
    z = (counter ^ (counter >> _S30)) * _MIX1
    z = (z ^ (z >> _S27)) * _MIX2
    return np.float64((z ^ (z >> _S31)) >> _S11) * 2.0**-53


@inner
def next_uniform(streams, i):
    """The next number in [0, 1) of stream i; `streams` is uint64 (N,)."""
    streams[i] += _GAMMA
    return _mixed(streams[i])


@inner
def between(low, high, streams, i):
    """The next number of stream i, uniformly distributed over [low, high)."""
    return low + (high - low) * next_uniform(streams, i)


@inner
def _normal(u, v):
    """A standard normal number from two in [0, 1) (Box and Muller)."""
    return math.sqrt(-2.0 * math.log(1.0 - u)) * math.cos(2 * math.pi * v)


@inner
def normal(streams, i):
    """The next standard normal number of stream i."""
    u = next_uniform(streams, i)
    return _normal(u, next_uniform(streams, i))


# Rough ground: a foothold at every step, each on its own straight piece of ground after the last


class Ground(NamedTuple):
    """The ground of an episode."""

    ground_seed: Any  # which ground it is, a number in [0, 1)
    slope_std: Any  # standard deviation of its pieces' slopes (rad); 0 on even ground


#: Largest deviation of a piece's slope, in leg angles. Beyond a half, a wheel that touches down
#: could be past its next touchdown.
MOST_TURN = 0.45


@inner
def ground_turn(ground, k, alpha):
    """By how much the ground from the k-th foothold to the next is steeper than the slope (rad).

    It depends on nothing else, so that a wheel that steps back meets the same ground. An episode
    begins at foothold 0, on even ground to both sides.
    """
    if ground.slope_std == 0.0 or k == 0 or k == -1:
        return 0.0
    counter = np.uint64(ground.ground_seed * 2.0**53) + np.uint64(2 * k) * _GAMMA
    drawn = ground.slope_std * _normal(_mixed(counter), _mixed(counter + _GAMMA))
    return min(max(drawn, -MOST_TURN * alpha), MOST_TURN * alpha)


@cached()
def _ground_turns(seed, slope_std, alpha, first, turns):
    for j in range(len(turns)):
        turns[j] = ground_turn(Ground(seed, slope_std), first + j, alpha)


def ground_turns(ground: Ground, alpha: float, first: int, last: int) -> NDArray[np.float64]:
    """`ground_turn` of the pieces `first` to `last` - 1, for callers in Python."""
    turns = np.empty(last - first)
    _ground_turns(float(ground.ground_seed), float(ground.slope_std), alpha, first, turns)
    return turns
