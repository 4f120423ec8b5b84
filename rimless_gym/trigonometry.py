"""Sine and cosine that a compiler can vectorise; those of libraries take one number per call.

x is reduced to r = x - k pi/2 in [-pi/4, pi/4]. There sin r and cos r are minimax polynomials;
the quadrant k picks one of them and its sign. Where a program needs both functions, they share
that work. The absolute error is below 2.5e-16 for |x| < 1e5; sin is exactly odd, cos exactly even.

Within a step an angle turns only a little from one whose sine and cosine are known. `sin_turned`
and `cos_turned` take (sine, cosine, turn) and need only shorter polynomials of the turn.
"""

from __future__ import annotations

import math

import numpy as np

from rimless_gym.jit import inlined

_ROUND = 1.5 * 2.0**52  # adding and subtracting it rounds to an integer, which its low bits hold
# pi / 2 in two parts. k times the first is exact up to k = 2^20, so that x - k pi / 2 is accurate
# even on processors without a fused multiply-add.
_HALF_PI = 1.5707963267341256
_REST = 6.077100506506192e-11
_S = (
    *(-0.166666666666666, 0.008333333333316487, -0.0001984126982593771, 2.7557312545727262e-06),
    *(-2.505060035578361e-08, 1.588859139818359e-10),
)
_C = (
    *(0.04166666666660227, -0.0013888888878275435, 2.480158097198972e-05, -2.755556716737581e-07),
    2.064773923850789e-09,
)


@inlined
def _reduced(x):
    """(k as bits, sin r, cos r)."""
    rounded = x * (2 / math.pi) + _ROUND
    k = rounded - _ROUND
    r = (x - k * _HALF_PI) - k * _REST
    z = r * r
    s = r + r * z * (_S[0] + z * (_S[1] + z * (_S[2] + z * (_S[3] + z * (_S[4] + z * _S[5])))))
    c = 1.0 - 0.5 * z + z * z * (_C[0] + z * (_C[1] + z * (_C[2] + z * (_C[3] + z * _C[4]))))
    return np.float64(rounded).view(np.int64), s, c


@inlined
def _signed(value, bits):
    """The value, negative where the second bit is set."""
    sign = (bits & 2) << 62
    return np.int64(np.float64(value).view(np.int64) ^ sign).view(np.float64)


@inlined
def sin(x):
    """Sine of x (rad)."""
    k, s, c = _reduced(x)
    return _signed(c if k & 1 else s, k)


@inlined
def cos(x):
    """Cosine of x (rad)."""
    k, s, c = _reduced(x)
    return _signed(s if k & 1 else c, k + 1)


#: Up to this turn (rad) the error is only rounding, below 3.5e-16; beyond, it grows like turn^11.
MAX_TURN = 0.25

_TURN_S = (
    *(-0.1666666666666255, 0.008333333327984367),
    *(-0.00019841246799989548, 2.7516830158333485e-06),
)
_TURN_C = (
    *(0.04166666666666201, -0.0013888888883502848),
    *(2.480156592374761e-05, -2.75219614266519e-07),
)


@inlined
def _turn(d):
    """(sin d, cos d) of a small angle."""
    z = d * d
    s = d + d * z * (_TURN_S[0] + z * (_TURN_S[1] + z * (_TURN_S[2] + z * _TURN_S[3])))
    c = z * z * (_TURN_C[0] + z * (_TURN_C[1] + z * (_TURN_C[2] + z * _TURN_C[3])))
    return s, 1.0 - 0.5 * z + c


@inlined
def sin_turned(angle):
    """Sine of an angle given as (sine, cosine, turn): a nearby angle and the turn from it (rad)."""
    sine, cosine, turn = angle
    s, c = _turn(turn)
    return sine * c + cosine * s


@inlined
def cos_turned(angle):
    """Cosine of an angle given as (sine, cosine, turn), as in `sin_turned`."""
    sine, cosine, turn = angle
    s, c = _turn(turn)
    return cosine * c - sine * s
