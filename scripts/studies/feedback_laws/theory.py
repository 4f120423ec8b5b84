"""What theory states of two linearisations: where one is stable, and that the other is impossible.

The zero dynamics are the motion along a gait's virtual constraint
(`trajopt.feedback.constraint`). The wheel follows the gait's path q_d(t) at another pace:
q = q_d(tau). The model, linear in V near the gait, then reads

    q_d' tau'' + q_d'' tau'^2 = a(q_d, q_d' tau', V* + v) = a + g v

Two equations for tau'' and v. Near tau' = 1 the first is (tau' - 1)' = D(t) (tau' - 1), where D
solves q_d' D - g w = (da/dq') q_d' - 2 q_d''. A touchdown maps rates linearly and the path's end
onto its start, so it leaves tau' as it is. The deviation is multiplied by exp of the integral of D
in a stride: it is one number, and a property of the gait's path alone, not of the law's gains
(Westervelt, Grizzle and Koditschek, Hybrid zero dynamics of planar biped walkers, IEEE TAC 2003).

Input-state linearisation is a change of the state and of the input that makes the machine linear.
x' = f(x) + g(x) V, with four states and one input, is linear in other coordinates if and only if

    g, ad_f g, ad_f^2 g, ad_f^3 g    are independent (accessibility), and
    span{g, ad_f g, ad_f^2 g}        contains the Lie brackets of its fields (involutivity)

(Jakubczyk and Respondek 1980; Isidori, Nonlinear Control Systems, 4.2). ad_f g is the Lie bracket
[f, g] = (dg/dx) f - (df/dx) g.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import casadi as ca
import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt.feedback.constraint import constraint_of
from trajopt.feedback.law import Floats
from trajopt.gaits.solution import Solution
from trajopt.gaits.stability import jacobians

#: Gauss points between two breakpoints of the voltage.
POINTS = 8


def zero_dynamics_multiplier(solution: Solution) -> float:
    """What a deviation in pace along the gait's path is multiplied by in a stride.

    Less than 1: a law that holds the virtual constraint holds the gait.
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


class LinearisationConditions(NamedTuple):
    """How far the two conditions are from failing and from holding, at N states.

    Vectors are scaled to length 1 first, so that 0 and 1 are the ends of every scale.
    """

    # least singular value of (g, ad_f g, ad_f^2 g, ad_f^3 g), shape (N,); the rank is 4 where it is
    # not 0
    accessibility: Floats
    # the largest part of the three brackets of g, ad_f g and ad_f^2 g outside their span, shape
    # (N,); the span is involutive where it is 0
    involutivity: Floats


def linearisation_conditions(params: WheelParams, states: Floats) -> LinearisationConditions:
    """The two conditions at states (N, 4) in single stance.

    What a gear loses under load is not affine in V: it is taken out of the machine.
    """
    fields, brackets = (np.asarray(each) for each in _fields(params).map(len(states))(states.T))
    pairs = [
        _at(fields[:, 4 * i : 4 * i + 4], brackets[:, 3 * i : 3 * i + 3])
        for i in range(len(states))
    ]
    return LinearisationConditions(*(np.array(each) for each in zip(*pairs, strict=True)))


def _fields(params: WheelParams) -> ca.Function:
    """x -> (g, ad_f g, ad_f^2 g, ad_f^3 g) (4, 4), and the brackets of the first three (4, 3)."""
    smooth = HybridModel(params.replace(gear_loss=0.0))
    x = ca.SX.sym("x", 4)
    f = smooth.flow(x, 0.0)
    columns = [smooth.flow(x, 1.0) - f]
    for _ in range(3):
        columns.append(_bracket(f, columns[-1], x))
    g, one, two, _ = columns
    pairs = (_bracket(a, b, x) for a, b in ((g, one), (g, two), (one, two)))
    return ca.Function("fields", [x], [ca.horzcat(*columns), ca.horzcat(*pairs)])


def _bracket(a: ca.SX, b: ca.SX, x: ca.SX) -> ca.SX:
    """The Lie bracket [a, b]."""
    return ca.jtimes(b, x, a) - ca.jtimes(a, x, b)


def _at(fields: Floats, brackets: Floats) -> tuple[float, float]:
    """The two numbers of `LinearisationConditions` at one state."""
    unit = fields / np.linalg.norm(fields, axis=0)
    normal = np.linalg.svd(unit[:, :3])[0][:, 3]  # of the span
    sizes = np.maximum(np.linalg.norm(brackets, axis=0), np.finfo(float).tiny)
    outside = np.abs(normal @ brackets) / sizes
    return float(np.linalg.svd(unit, compute_uv=False)[-1]), float(outside.max())
