"""The periodic gait of the rimless wheel as an optimal control problem."""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np

from rimless_gym.hybrid import MAX_RATE
from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt.problem import Array, Constraint, Linkage, Phase, Problem

#: Least normal force, in weights: a gait on the brink of lift-off could not be tracked.
MIN_NORMAL_FORCE = 0.05

#: Least phi' just before and just after a touchdown (rad/s): the guard must be crossed.
MIN_TOUCHDOWN_RATE = 0.01

#: How far within a step phi keeps off the guards (rad): a graze of 1e-7 would be a touchdown.
GUARD_MARGIN = 1e-6


def gait_problem(
    params: WheelParams,
    *,
    speed: float,
    steps: int,
    theta_turns: int = 0,
    regeneration: bool = False,
) -> Problem:
    """`steps` single-stance phases in a ring, joined by touchdowns, of least electrical energy.

    Args:
        params: the machine.
        speed: mean speed along the ground (m/s), imposed through the stride's duration.
        steps: touchdowns per stride.
        theta_turns: whole turns that theta gains in a stride.
        regeneration: whether the battery takes energy back.
    """
    touchdown = HybridModel(params).functions["touchdown"]
    phase = stance(params, regeneration=regeneration)
    turn = np.array([0.0, -2 * math.pi * theta_turns, 0.0, 0.0])
    linkages = [
        Linkage(i, (i + 1) % steps, touchdown, turn if i == steps - 1 else np.zeros(4))
        for i in range(steps)
    ]
    return Problem((phase,) * steps, tuple(linkages), steps * params.step_length / speed)


def stance(params: WheelParams, *, regeneration: bool) -> Phase:
    """Single stance from one forward touchdown to the next; rocking back within it is legal."""
    model = HybridModel(params)
    c, inf = params.constants, math.inf
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    fx, fy = ca.vertsplit(model.ground_reaction(x, u) / params.weight)
    path = Constraint(
        ca.Function("contact", [x, u], [_inside_cone(fx, fy, params)]),
        np.array([MIN_NORMAL_FORCE, 0.0, 0.0]),
        np.full(3, inf),
        ("normal force", "friction cone (forward)", "friction cone (backward)"),
    )
    momentum = model.functions["linear_momentum"]
    after = model.touchdown(x)
    px, py = ca.vertsplit((momentum(after) - momentum(x)) / params.total_mass)
    end = Constraint(
        ca.Function("touchdown", [x], [ca.vertcat(_inside_cone(px, py, params), after[2])]),
        np.array([0.0, 0.0, 0.0, MIN_TOUCHDOWN_RATE]),
        np.full(4, inf),
        (
            "upward touchdown impulse",
            "friction cone of the touchdown impulse (forward)",
            "friction cone of the touchdown impulse (backward)",
            "phi' after touchdown",
        ),
    )
    rate = MAX_RATE
    return Phase(
        flow=model.functions["flow"],
        power=ca.Function("power", [x, u], [model.electrical_power(x, u) + params.idle_power]),
        path=path,
        end=end,
        state_bounds=_bounds(
            (c.a + GUARD_MARGIN, c.b - GUARD_MARGIN), (-inf, inf), (-rate, rate), (-rate, rate)
        ),
        start_bounds=_bounds((c.a, c.a), (-inf, inf), (0.0, rate), (-rate, rate)),
        end_bounds=_bounds((c.b, c.b), (-inf, inf), (MIN_TOUCHDOWN_RATE, rate), (-rate, rate)),
        control_bounds=_bounds((-params.voltage_limit, params.voltage_limit)),
        duration_bounds=(0.02, inf),
        floor=-inf if regeneration else params.idle_power,
    )


def _inside_cone(fx: ca.SX, fy: ca.SX, params: WheelParams) -> ca.SX:
    return ca.vertcat(fy, params.friction * fy - fx, params.friction * fy + fx)


def _bounds(*pairs: Sequence[float]) -> tuple[Array, Array]:
    table = np.array(pairs, dtype=float)
    return table[:, 0], table[:, 1]
