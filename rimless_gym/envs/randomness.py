"""Random numbers for compiled code: one splitmix64 stream per row, seeded when an episode starts.

An episode takes a single 64-bit key from its row's NumPy generator. Everything random in it
(machine, start, pushes, sensor noise, delay) comes from the stream that begins at that key. So a
row draws the same numbers whether it is stepped alone or among others.
"""

from __future__ import annotations

import math

import numpy as np

from rimless_gym.jit import inner

_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MIX1, _MIX2 = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S27, _S30, _S31, _S11 = np.uint64(27), np.uint64(30), np.uint64(31), np.uint64(11)


@inner
def next_uniform(streams, i):
    """The next number in [0, 1) of stream i; `streams` is uint64 (N,)."""
    streams[i] += _GAMMA
    z = streams[i]
    z = (z ^ (z >> _S30)) * _MIX1
    z = (z ^ (z >> _S27)) * _MIX2
    return np.float64((z ^ (z >> _S31)) >> _S11) * 2.0**-53


@inner
def between(low, high, streams, i):
    """The next number of stream i, uniformly distributed over [low, high)."""
    return low + (high - low) * next_uniform(streams, i)


@inner
def normal(streams, i):
    """The next standard normal number of stream i (Box and Muller)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - next_uniform(streams, i)))
    return radius * math.cos(2 * math.pi * next_uniform(streams, i))
