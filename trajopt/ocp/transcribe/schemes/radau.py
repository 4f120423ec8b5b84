"""Legendre-Gauss-Radau collocation of any degree d, at the flipped Radau points.

On every element the state is a polynomial of degree d that satisfies the differential equation at
the d flipped Radau points, the last of which is the element's end. As an integrator this is Radau
IIA, of order 2d - 1 at the edges (Hairer and Wanner, Solving ODEs II, IV.5; for optimal control
Garg et al., A unified framework, Automatica 46 (2010)). The control is a Bezier polynomial of lower
degree and may jump at the elements' edges:

- It lies in the convex hull of its coefficients, so that bounds on these hold everywhere.
- Within an element it is smooth, and so is the state, which converges at full order.
- Slacks and path constraints are imposed at the Radau points and on both sides of every edge. They
  outnumber the control's degrees of freedom and leave it no room to cheat in between.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from trajopt.ocp.transcribe.schemes.polynomials import (
    bernstein_matrix,
    control_nodes,
    differentiation_matrix,
    quadrature_weights,
    radau_nodes,
)
from trajopt.ocp.transcribe.schemes.scheme import Scheme


@lru_cache
def radau(degree: int, control_degree: int | None = None) -> Scheme:
    """The scheme of degree `degree` >= 1.

    Args:
        degree: of the state.
        control_degree: of the control, from 0 to max(1, degree - 1), the default.
    """
    nodes, most = radau_nodes(degree), max(1, degree - 1)
    control_degree = most if control_degree is None else min(control_degree, most)
    knots = control_nodes(control_degree)
    return Scheme(
        nodes=nodes,
        D=differentiation_matrix(degree),
        A=np.hstack([np.zeros((degree, 1)), np.eye(degree)]),
        quadrature=np.concatenate([[0.0], quadrature_weights(degree)]),
        control_nodes=knots,
        control_basis=bernstein_matrix(control_degree, nodes),
        control_values=bernstein_matrix(control_degree, knots),
        shared_controls=False,
        order=2 * degree - 1,
    )
