"""Whether a change of the state and of the input makes the whole machine linear.

x' = f(x) + g(x) V, with four states and one input, is linear in other coordinates if and only if

    g, ad_f g, ad_f^2 g, ad_f^3 g    are independent (accessibility), and
    span{g, ad_f g, ad_f^2 g}        contains the Lie brackets of its fields (involutivity)

(Jakubczyk and Respondek 1980; Isidori, Nonlinear Control Systems, 4.2). ad_f g is the Lie bracket
[f, g] = (dg/dx) f - (df/dx) g.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt.feedback.law import Floats, states_and_modes


class LinearisationConditions(NamedTuple):
    """How far the two conditions are from failing and from holding, at N states.

    Vectors are scaled to length 1 first, so that 0 and 1 are the ends of every scale.

    Attributes:
        accessibility: least singular value of (g, ad_f g, ad_f^2 g, ad_f^3 g), shape (N,); the
            rank is 4 where it is not 0.
        involutivity: the largest part of the three brackets of g, ad_f g and ad_f^2 g outside
            their span, shape (N,); the span is involutive where it is 0.
    """

    accessibility: Floats
    involutivity: Floats


def linearisation_conditions(params: WheelParams, x: ArrayLike) -> LinearisationConditions:
    """The two conditions at states in single stance.

    What a gear loses under load is not affine in V: it is taken out of the machine.

    Args:
        params: the machine.
        x: states, shape (N, 4) or (4,).

    Raises:
        TypeError: the states are not real numbers.
        ValueError: they have another shape, or one is not finite or larger than
            `trajopt.feedback.law.LARGEST`.
    """
    states, _ = states_and_modes(x, 0)
    fields, brackets = (np.asarray(each) for each in _fields(params).map(len(states))(states.T))
    found = [
        _at(fields[:, 4 * i : 4 * i + 4], brackets[:, 3 * i : 3 * i + 3])
        for i in range(len(states))
    ]
    return LinearisationConditions(*(np.array(each) for each in zip(*found, strict=True)))


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
