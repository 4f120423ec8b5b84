"""The zero dynamics of a gait's virtual constraint: how the wheel moves along it.

On the constraint the wheel follows the gait's path q_d(t) at another pace: q = q_d(tau). The model,
linear in V near the gait, then reads

    q_d' tau'' + q_d'' tau'^2 = a(q_d, q_d' tau', V* + v) = a + g v

Two equations for tau'' and v. Near tau' = 1 the first is (tau' - 1)' = D(t) (tau' - 1), where D
solves q_d' D - g w = (da/dq') q_d' - 2 q_d''. A touchdown maps rates linearly and the path's end
onto its start, so it leaves tau' as it is. The deviation is multiplied by exp of the integral of D
in a stride: it is one number, and a property of the gait's path alone, not of the law's gains
(Westervelt, Grizzle and Koditschek, Hybrid zero dynamics of planar biped walkers, IEEE TAC 2003).
"""

from __future__ import annotations

import math

import numpy as np

from rimless_gym.symbolic import HybridModel
from trajopt.feedback.constraint import constraint_of
from trajopt.gaits.solution import Solution
from trajopt.gaits.stability import jacobians

#: Gauss points between two breakpoints of the voltage.
POINTS = 8


def zero_dynamics_multiplier(solution: Solution) -> float:
    """What a deviation in pace along the gait's path is multiplied by in a stride.

    Less than 1: a law that holds the virtual constraint holds the gait.

    Raises:
        TypeError: `solution` is not a `trajopt.Solution`.
        ValueError: the gait has no virtual constraint.
    """
    constraint_of(solution)  # refuses gaits that have none
    knots = np.concatenate([[0.0], solution.breakpoints])
    nodes, weights = np.polynomial.legendre.leggauss(POINTS)
    half = 0.5 * np.diff(knots)[:, None]
    t = knots[:-1, None] + half * (nodes + 1.0)
    growth = [_growth(solution, time) for time in t.ravel()]
    return math.exp((half * weights).ravel() @ growth)


def _growth(solution: Solution, t: float) -> float:
    """D (1/s) at a time."""
    x, u = solution.state(t), solution.control(t)
    A, B, _ = (np.asarray(each) for each in jacobians(solution.params)(x, u))
    accelerations = np.asarray(HybridModel(solution.params).flow(x, u)).ravel()[2:]
    rates = x[2:]
    rest = A[2:, 2:] @ rates - 2 * accelerations
    return float(np.linalg.solve(np.column_stack([rates, -B[2:, 0]]), rest)[0])
