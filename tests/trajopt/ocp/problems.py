"""Problems and trajectories that several tests share."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.presets import THESIS_PHYSICAL
from rimless_gym.symbolic import HybridModel
from scripts.studies.textbook import PROBLEMS
from trajopt import Extremal, Linkage, Phase, PhaseTrajectory, Problem, solve
from trajopt.ocp.scaling import PhaseScales, Scales
from trajopt.ocp.schemes import radau_nodes

FREE = math.inf
NONE = np.zeros(0)


@functools.cache
def solved(name: str) -> Extremal:
    """The solution of the textbook's problem of this name, solved once for all tests."""
    return solve(next(example for example in PROBLEMS if example.name == name).problem())


def solve_once(problem: Problem, *arguments: Any, **settings: Any) -> Extremal:
    """A solution on one mesh, which is not simulated."""
    return solve(problem, *arguments, **{"passes": 0, "verify": False} | settings)


def move(**more: Any) -> Phase:
    """A block of 1 kg from rest to rest 1 m away in 1 s at least effort, 12 m^2 / s^3."""
    return Phase(
        **{
            "name": "move",
            "states": ("x", "v"),
            "controls": ("u",),
            "flow": lambda x, u, p: (x[1], u),
            "cost": lambda x, u, p: u**2,
            "start": {"x": 0.0, "v": 0.0},
            "end": {"x": 1.0, "v": 0.0},
            "duration": 1.0,
        }
        | more,
    )


def block(force: float = 1.0) -> Phase:
    return Phase(
        "move",
        states=("x", "v"),
        controls=("u",),
        flow=lambda x, u, p: (x[1], u),
        powers=lambda x, u, p: u * x[1],
        bounds={"u": (-force, force)},
    )


def sampled(
    edges: Sequence[float] | np.ndarray, control: Callable[[np.ndarray], Any], degree: int = 6
) -> PhaseTrajectory:
    """A trajectory whose states and control are those of u = control(t), x = v = 1 + u."""
    nodes, edges = radau_nodes(degree), np.array(edges)
    t = edges[:-1, None] + np.diff(edges)[:, None] * nodes
    u = np.array(control(t))
    return PhaseTrajectory(
        np.array(edges), nodes, np.stack([1 + u, 1 + u], axis=-1), nodes, u[..., None]
    )


def ones(phase: Phase) -> PhaseScales:
    """Scales of one: quantities are measured in their own units."""
    rows = (c and c.names for c in phase.constraints)
    sizes = map(len, (phase.states, phase.controls, *(names or () for names in rows)))
    states, controls, *limits = map(np.ones, sizes)
    powers = phase.powers.size1_out(0) if phase.powers else 0
    return PhaseScales(states, controls, 1.0, np.ones(powers), *limits)


def unit_scales(states: int) -> Scales:
    """Scales of one, of a problem of one phase without controls."""
    none = np.empty(0)
    phase = PhaseScales(np.ones(states), none, 1.0, none, none, none, none, none)
    return Scales((phase,), none, none, 1.0)


def valley(**bounds: Any) -> Problem:
    """From (0, 0) to (1, 0) along a ridge that pays for leaving it, to either side alike."""
    ridge = Phase(
        "ridge",
        states=("x", "y"),
        flow=lambda x, u, p: u,
        controls=("u", "v"),
        cost=lambda x, u, p: ca.sumsqr(u) - 100 * x[1] ** 2,
        start={"x": 0.0, "y": 0.0},
        end={"x": 1.0, "y": 0.0},
        bounds=bounds,
        duration=1.0,
    )
    return Problem((ridge,))


def passive_wheel(legs: int = 8, slope: float = 0.12) -> Problem:
    """The only cycle of a bare wheel down a slope; the cost is its rate after touchdown (rad/s)."""
    params = _bare_wheel(legs, slope)
    model = HybridModel(params)

    def full(x: Any) -> Any:
        return ca.vertcat(x[0], 0, x[1], 0)

    stance = Phase(
        "stance",
        states=("phi", "dphi"),
        flow=lambda x, u, p: model.flow(full(x), 0.0)[[0, 2]],
        start={"phi": params.constants.a, "dphi": (0.1, 10.0)},
        end={"phi": (params.constants.a, params.constants.a + 2 * params.constants.alpha)},
        duration=(0.05, 5.0),
    )
    return Problem(
        (stance,),
        linkages=(Linkage(0, 0, lambda x, p: model.touchdown(full(x))[[0, 2]]),),
        endpoint_cost=lambda starts, ends, durations, p: starts[0][1],
    )


def passive_wheel_rate(legs: int = 8, slope: float = 0.12) -> float:
    """The cycle's rate after touchdown (rad/s): Tedrake, Underactuated Robotics, "Simple legs"."""
    params, a = _bare_wheel(legs, slope), math.pi / legs
    push = 4 * params.gravity / params.leg_length * math.sin(a) * math.sin(slope)
    return math.sqrt(push) / math.tan(2 * a)


def _bare_wheel(legs: int, slope: float) -> WheelParams:
    return THESIS_PHYSICAL.replace(
        n_legs=legs,
        slope=slope,
        wheel_inertia=0.0,
        pendulum_length=0.0,
        pendulum_inertia=0.1,
        motor_constant=0.0,
    )
