"""Sine and cosine that a compiler can vectorise: the libraries' are calls, one number at a time.

x is reduced to r = x - k pi/2 in [-pi/4, pi/4]; sin r and cos r are minimax polynomials there,
and the quadrant k picks one of them and its sign. Both functions share that work where a program
needs both. Absolute error below 2.5e-16 for |x| < 1e5; sin is exactly odd, cos even.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_ROUND = 1.5 * 2.0**52  # adding and subtracting it rounds to an integer, which its low bits hold
_REST = 6.123233995736766e-17  # pi/2 - math.pi / 2
_S = (
    *(-0.166666666666666, 0.008333333333316487, -0.0001984126982593771, 2.7557312545727262e-06),
    *(-2.505060035578361e-08, 1.588859139818359e-10),
)
_C = (
    *(0.04166666666660227, -0.0013888888878275435, 2.480158097198972e-05, -2.755556716737581e-07),
    2.064773923850789e-09,
)

_inlined = njit(error_model="numpy", fastmath={"contract"}, forceinline=True)


@_inlined
def _reduced(x):
    """(k as bits, sin r, cos r)."""
    rounded = x * (2 / math.pi) + _ROUND
    k = rounded - _ROUND
    r = (x - k * (math.pi / 2)) - k * _REST
    z = r * r
    s = r + r * z * (_S[0] + z * (_S[1] + z * (_S[2] + z * (_S[3] + z * (_S[4] + z * _S[5])))))
    c = 1.0 - 0.5 * z + z * z * (_C[0] + z * (_C[1] + z * (_C[2] + z * (_C[3] + z * _C[4]))))
    return np.float64(rounded).view(np.int64), s, c


@_inlined
def _signed(value, bits):
    """The value, negative where the second bit is set."""
    sign = (bits & 2) << 62
    return np.int64(np.float64(value).view(np.int64) ^ sign).view(np.float64)


@_inlined
def sin(x):
    """Sine of x (rad)."""
    k, s, c = _reduced(x)
    return _signed(c if k & 1 else s, k)


@_inlined
def cos(x):
    """Cosine of x (rad)."""
    k, s, c = _reduced(x)
    return _signed(s if k & 1 else c, k + 1)
