"""A control interval, or one side of it, as an element of the nonlinear program."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from rimless_gym.params import WheelParams
from trajopt.gaits.stance import STATES, WheelPhases
from trajopt.ocp.arrays import Array
from trajopt.ocp.equations import element, path_nodes
from trajopt.ocp.problem import Phase
from trajopt.ocp.schemes import SCHEMES, Scheme, lagrange_matrix

#: Degree of the states within an interval, and the scheme with a constant control.
DEGREE = 4
SCHEME: Scheme = SCHEMES["radau"].of_degree(DEGREE, 0)

#: Where in an interval the power is taken that is paid, and the trapezoidal rule's weights. While
#: the wheel coasts, the current changes sign within most intervals. Of max(V i, 0), which is convex
#: there, this rule takes too much (by 1e-4 of the whole), where Gauss's or the midpoint rule takes
#: too little, which an optimisation would exploit.
PAID_AT: Array = np.linspace(0.0, 1.0, 21)
WEIGHTS: Array = np.convolve(np.ones(len(PAID_AT) - 1), [0.5, 0.5]) / (len(PAID_AT) - 1)


#: Places in an interval without a touchdown at which phi is kept away from the guards, besides the
#: nodes, because a leg may rock back and almost touch down. It keeps a distance of GRAZE hold^2
#: (rad). Between two places phi can go 0.0016 phi'' hold^2 further, so this suffices up to a phi''
#: of 12 rad/s^2.
GUARDED_AT: Array = np.arange(1, 9) / 9.0
GRAZE = 0.02


@dataclasses.dataclass(frozen=True)
class Equations:
    """The functions of the program, and their bounds.

    The states of an element are its left end (4), the nodes inside (4 each) and its right end.

    Attributes:
        phase: the step of which intervals are parts.
        whole: (states, V, slacks) -> (defects, path constraints, slacks less powers, phi at
            `GUARDED_AT`), cost.
        part: the same without phi, with the share of a touchdown after the slacks, and data
            (a, b): the element's length is a + b share, in intervals.
        touchdown: (state before, state after) -> (mismatch, constraints at touchdown), no cost.
        slacks: how many.
        whole_bounds: of the outputs of `whole`, (lower, upper).
        part_bounds: of those of `part`.
        touchdown_bounds: of the outputs of `touchdown`, theta's turns left out.
    """

    phase: Phase
    whole: ca.Function
    part: ca.Function
    touchdown: ca.Function
    slacks: int
    whole_bounds: tuple[Array, Array]
    part_bounds: tuple[Array, Array]
    touchdown_bounds: tuple[Array, Array]


@lru_cache(maxsize=8)
def interval_equations(params: WheelParams, hold: float, regeneration: bool) -> Equations:
    """The functions of one machine, clock and objective."""
    wheel = WheelPhases(params)
    stance, c = wheel.single_stance(), params.constants
    bounds = {**stance.bounds, "phi": (c.a, c.b)}  # the program keeps phi off the guards
    phase = dataclasses.replace(stance, powers=None, bounds=bounds).traced(0)
    assert phase.path is not None
    assert phase.at_end is not None
    nx, n = len(STATES), len(SCHEME.nodes)
    slacks = 0 if regeneration else len(PAID_AT)
    x, u, s = ca.SX.sym("x", nx * n), ca.SX.sym("u"), ca.SX.sym("s", slacks)
    share, data, none = ca.SX.sym("share"), ca.SX.sym("d", 2), ca.SX.sym("none", 0)
    power = wheel.of("electrical_power")
    states = ca.reshape(x, nx, n)

    def powers(points: Array) -> Any:
        at = states @ ca.DM(lagrange_matrix(SCHEME.nodes, points)).T
        return ca.vertcat(*(power(column, u, none) for column in ca.horzsplit(at)))

    if regeneration:
        mean = ca.dot(powers(SCHEME.nodes), ca.DM(SCHEME.quadrature))
        unpaid = ca.SX(0, 1)
    else:
        mean = ca.dot(s, ca.DM(WEIGHTS))
        unpaid = s - powers(PAID_AT)
    equations = element(phase, SCHEME, 0)
    phi = states[STATES.index("phi"), :] @ ca.DM(lagrange_matrix(SCHEME.nodes, GUARDED_AT)).T

    def function(name: str, length: Any, inputs: Any, data: Any, *more: Any) -> ca.Function:
        outputs, _ = equations(ca.vertcat(x, u, hold * length), 1.0)
        outputs = ca.densify(ca.vertcat(outputs, unpaid, *more))
        return ca.Function(name, [inputs, data], [outputs, hold * length * mean])

    before, after = ca.SX.sym("before", nx), ca.SX.sym("after", nx)
    mismatch = after - wheel.of("touchdown")(before, none)
    landing = ca.vertcat(mismatch, phase.at_end.function(before, none))
    places = len(path_nodes(SCHEME))
    defects = np.zeros(nx * DEGREE)
    lower, upper = (np.tile(side, places) for side in (phase.path.lower, phase.path.upper))
    lower = np.concatenate([defects, lower, np.zeros(slacks)])
    upper = np.concatenate([defects, upper, np.full(slacks, np.inf)])
    margin, apart = GRAZE * hold**2, np.ones(len(GUARDED_AT))
    share_of = data[0] + data[1] * share
    return Equations(
        phase=phase,
        whole=function("whole", 1.0, ca.vertcat(x, u, s), none, phi.T),
        part=function("part", share_of, ca.vertcat(x, u, s, share), data),
        touchdown=ca.Function("touchdown", [ca.vertcat(before, after), none], [landing, ca.SX(0)]),
        slacks=slacks,
        whole_bounds=(
            np.concatenate([lower, (c.a + margin) * apart]),
            np.concatenate([upper, (c.b - margin) * apart]),
        ),
        part_bounds=(lower, upper),
        touchdown_bounds=(
            np.concatenate([np.zeros(nx), phase.at_end.lower]),
            np.concatenate([np.zeros(nx), phase.at_end.upper]),
        ),
    )
