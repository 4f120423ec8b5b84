"""What docs/feedback.md states of the theory of linearisation, computed from the model.

The formulas of the zero dynamics and of the two conditions stand on the page.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest

from rimless_gym import BUILDABLE, THESIS_PHYSICAL, WheelParams
from rimless_gym.presets import preset
from rimless_gym.symbolic import HybridModel
from trajopt import Solution, periodic_gait
from trajopt.feedback.constraint import constraint_of
from trajopt.feedback.law import Floats
from trajopt.feedback.laws import input_output
from trajopt.feedback.transverse import multipliers
from trajopt.gaits.verify import jacobians

# -- zero dynamics --------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "speed", "predicted", "measured"),
    [
        ("BUILDABLE", 0.45, 0.57, 0.56),
        ("BUILDABLE", 0.5, 0.60, 0.59),
        ("BUILDABLE", 0.56, 0.63, 0.63),
        ("BUILDABLE", 0.605, 0.67, 0.67),
        ("THESIS_PHYSICAL", 0.5, 0.53, 0.47),
        ("THESIS_PHYSICAL", 0.57, 0.71, 0.73),
    ],
)
def test_the_zero_dynamics_are_those_of_the_page(machine, speed, predicted, measured):
    solution = periodic_gait(preset(machine), speed, hold=0.01)
    assert zero_dynamics_multiplier(solution) == pytest.approx(predicted, abs=0.006)
    found = multipliers(input_output.design(solution), solution)[0]
    assert found == pytest.approx(measured, abs=0.006)


def zero_dynamics_multiplier(solution: Solution) -> float:
    """What a deviation in pace along the gait's path is multiplied by in a stride."""
    constraint_of(solution)  # refuses gaits that have none
    knots = np.concatenate([[0.0], solution.breakpoints])
    nodes, weights = np.polynomial.legendre.leggauss(8)
    half = 0.5 * np.diff(knots)[:, None]
    t = knots[:-1, None] + half * (nodes + 1.0)
    growth = [_growth(solution, time) for time in t.ravel()]
    return math.exp((half * weights).ravel() @ growth)


def _growth(solution: Solution, t: float) -> float:
    """D (1/s) at a time, by which a deviation in pace grows.

    The wheel follows the gait's path q_d(t) at the pace tau'. The model, linear in V near the gait,
    q_d' tau'' + q_d'' tau'^2 = a + g v, gives q_d' D - g w = (da/dq') q_d' - 2 q_d''.
    """
    x, u = solution.state(t), solution.control(t)
    A, B, _ = (np.asarray(each) for each in jacobians(solution.params)(x, u))
    accelerations = np.asarray(HybridModel(solution.params).flow(x, u)).ravel()[2:]
    rates = x[2:]
    rest = A[2:, 2:] @ rates - 2 * accelerations
    return float(np.linalg.solve(np.column_stack([rates, -B[2:, 0]]), rest)[0])


# -- input-state linearisation --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("params", "reached", "median", "largest"),
    [(BUILDABLE, 0.007, 0.005, 0.23), (THESIS_PHYSICAL, 0.014, 0.018, 0.80)],
)
def test_the_voltage_reaches_every_direction_and_yet_nothing_makes_the_machine_linear(
    params, reached, median, largest
):
    found = linearisation_conditions(params)
    assert found.accessibility.min() > 1e-6
    assert np.median(found.accessibility) == pytest.approx(reached, abs=6e-4)
    assert np.median(found.involutivity) == pytest.approx(median, abs=6e-4)
    assert found.involutivity.max() == pytest.approx(largest, abs=6e-3)
    assert found.involutivity.min() > 5e-6


def test_a_reaction_wheel_in_the_pendulums_place_could_be_made_linear():
    found = linearisation_conditions(THESIS_PHYSICAL.replace(pendulum_length=1e-9))
    assert found.accessibility.min() > 1e-4
    assert np.median(found.involutivity) < 1e-6


class LinearisationConditions(NamedTuple):
    """How far the two conditions are from failing and from holding, at N states, shape (N,).

    Vectors are scaled to length 1 first, so that 0 and 1 are the ends of every scale.
    """

    accessibility: Floats  # least singular value of (g, ad_f g, ad_f^2 g, ad_f^3 g)
    # the largest part of the brackets of g, ad_f g and ad_f^2 g outside the span of these three
    involutivity: Floats


def linearisation_conditions(params: WheelParams, count: int = 200) -> LinearisationConditions:
    """The two conditions at random states in single stance.

    What a gear loses under load is not affine in V: it is taken out of the machine.
    """
    rng, c = np.random.default_rng(0), params.constants
    states = rng.uniform([c.a, -np.pi, -3, -12], [c.b, np.pi, 6, 12], (count, 4))
    fields, brackets = (np.asarray(each) for each in _fields(params).map(count)(states.T))
    pairs = [
        _at(fields[:, 4 * i : 4 * i + 4], brackets[:, 3 * i : 3 * i + 3]) for i in range(count)
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
