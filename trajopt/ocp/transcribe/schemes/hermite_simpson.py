"""Hermite-Simpson collocation, separated: a cubic state and a quadratic control per element.

    x_m = (x0 + x1)/2 + h/8 (f0 - f1),    x1 - x0 = h/6 (f0 + 4 f_m + f1)

Hargraves and Paris, Direct Trajectory Optimization (1987); Betts, Practical Methods for Optimal
Control, 2nd ed., 4.7.2; Kelly, SIAM Review 59 (2017), 4.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from trajopt.ocp.transcribe.schemes.scheme import Scheme


@lru_cache
def hermite_simpson() -> Scheme:
    """The scheme, of order 4."""
    nodes = np.array([0.0, 0.5, 1.0])
    return Scheme(
        nodes=nodes,
        D=np.array([[-0.5, 1.0, -0.5], [-1.0, 0.0, 1.0]]),
        A=np.array([[1 / 8, 0.0, -1 / 8], [1 / 6, 4 / 6, 1 / 6]]),
        quadrature=np.array([1 / 6, 4 / 6, 1 / 6]),
        control_nodes=nodes,
        control_basis=np.eye(3),
        control_values=np.eye(3),
        shared_controls=True,
        order=4,
    )
