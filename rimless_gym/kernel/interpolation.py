"""Quintic Hermite interpolation over one integration step, and its first root.

Value, rate and acceleration are known at both ends of a step, so events inside it are located to
the accuracy of the step itself (error ~ h^6 y^(6) / 46080) without evaluating the dynamics again.
Polynomials are in s = t/h in [0, 1] and written out as six scalars, which numba keeps in registers.
"""

from __future__ import annotations

from rimless_gym.jit import inner


@inner
def quintic(y0, v0, a0, y1, v1, a1, h):
    """Coefficients c0..c5 of the quintic with the given values, rates and accelerations."""
    c1, c2 = v0 * h, 0.5 * a0 * h * h
    d = y1 - y0 - c1 - c2
    e = (v1 - v0 - a0 * h) * h
    f = 0.5 * (a1 - a0) * h * h
    return y0, c1, c2, 10 * d - 4 * e + f, -15 * d + 7 * e - 2 * f, 6 * d - 3 * e + f


@inner
def value(c, s):
    """The polynomial at s."""
    return c[0] + s * (c[1] + s * (c[2] + s * (c[3] + s * (c[4] + s * c[5]))))


@inner
def slope(c, s):
    """Its derivative by s."""
    return c[1] + s * (2 * c[2] + s * (3 * c[3] + s * (4 * c[4] + s * 5 * c[5])))


@inner
def derivative(c):
    """Coefficients of the derivative by s."""
    return c[1], 2 * c[2], 3 * c[3], 4 * c[4], 5 * c[5], 0.0


@inner
def negative(c):
    """Coefficients with the sign changed."""
    return -c[0], -c[1], -c[2], -c[3], -c[4], -c[5]


@inner
def bracketed_root(c, low, high):
    """The root between `low`, where the polynomial is not positive, and `high`, where it is."""
    s = 0.5 * (low + high)
    for _ in range(100):
        f = value(c, s)
        if f > 0.0:
            high = s
        else:
            low = s
        newton = s - f / slope(c, s)
        following = newton if low <= newton <= high else 0.5 * (low + high)
        if abs(following - s) <= 1e-15:  # of s in [0, 1]; any closer, rounding makes it jump about
            return following
        s = following
    return s


@inner
def upward_root(c, s_end):
    """Where the polynomial crosses zero upward in [0, s_end], given that it is positive at s_end.

    If it starts on or above zero and rises, the crossing is at 0. If it starts at zero and falls
    (just after an impact), the root at 0 is divided out and the next one is returned.
    """
    if c[0] >= 0.0:
        if c[1] > 0.0 or (c[1] == 0.0 and c[2] >= 0.0):
            return 0.0
        c = (c[1], c[2], c[3], c[4], c[5], 0.0)
        if c[0] == 0.0:  # its rate is 0 too, just after a lift-off: a double root
            c = (c[1], c[2], c[3], c[4], c[5], 0.0)
    return bracketed_root(c, 0.0, s_end)
