"""Trapezoidal collocation: x1 - x0 = h/2 (f0 + f1), with a control linear on every element.

Betts, Practical Methods for Optimal Control, 2nd ed., 4.7.2; Kelly, An Introduction to Trajectory
Optimization, SIAM Review 59 (2017), 3.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from trajopt.ocp.transcribe.schemes.scheme import Scheme


@lru_cache
def trapezoid() -> Scheme:
    """The scheme, of order 2."""
    return Scheme(
        nodes=np.array([0.0, 1.0]),
        D=np.array([[-1.0, 1.0]]),
        A=np.array([[0.5, 0.5]]),
        quadrature=np.array([0.5, 0.5]),
        control_nodes=np.array([0.0, 1.0]),
        control_basis=np.eye(2),
        control_values=np.eye(2),
        shared_controls=True,
        order=2,
    )
