"""Linearisation of a gait: phase transition, saltation at touchdowns, Floquet multipliers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt.gaits.problem import stands
from trajopt.ocp.arrays import Array
from trajopt.ocp.schemes import differentiation_matrix, radau_nodes
from trajopt.ocp.trajectory import PhaseTrajectory


@lru_cache(maxsize=8)
def jacobians(params: WheelParams, flow: str = "flow", reset: str = "touchdown") -> ca.Function:
    """(x, u) -> (A, B, G): derivatives of a flow by x and u, and of a reset map by x.

    Both by their names in `HybridModel.functions`.
    """
    functions = HybridModel(params).functions
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    rates, after = functions[flow](x, u), functions[reset](x)
    outputs = [ca.jacobian(rates, x), ca.jacobian(rates, u), ca.jacobian(after, x)]
    return ca.Function("jacobians", [x, u], outputs)


def transition(params: WheelParams, phase: PhaseTrajectory, degree: int = 8) -> Array:
    """d x(end) / d x(start) over one phase, with times and control fixed, shape (4, 4).

    The variational equation, collocated on the phase's own elements.
    """
    derivatives, nodes = jacobians(params, _flow(phase)), radau_nodes(degree)
    D = differentiation_matrix(degree)
    total = np.eye(4)
    for start, h in zip(phase.edges, phase.element_durations, strict=False):
        t = start + h * nodes[1:]  # at the last of them the control may jump
        points = zip(phase.state(t), phase.control(t, "left")[:, 0], strict=True)
        system = np.kron(D[:, 1:], np.eye(4))
        for i, (x, u) in enumerate(points):
            block = slice(4 * i, 4 * i + 4)
            system[block, block] -= h * np.asarray(derivatives(x, u)[0])
        inner = np.linalg.solve(system, -np.kron(D[:, :1], np.eye(4)))
        total = inner[-4:] @ total
    return np.asarray(total)


def _flow(phase: PhaseTrajectory) -> str:
    return "flow_double_stance" if stands(phase) else "flow"


def saltation(params: WheelParams, phase: PhaseTrajectory, following: PhaseTrajectory) -> Array:
    """How the end of a phase maps a deviation at a fixed time, shape (4, 4).

    A deviation moves a touchdown in time as well as the state that it maps (Leine and Nijmeijer,
    Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 7.2). A lift-off is when the clock
    makes the voltage jump, and maps nothing.
    """
    if stands(phase):
        return np.eye(4)
    reset = "stop_on_two_feet" if stands(following) else "touchdown"
    u_before = float(phase.control([phase.duration], "left")[0, 0])
    functions, before = HybridModel(params).functions, phase.end
    flow_before = functions["flow"](before, u_before).full().ravel()
    after = functions[reset](before)
    flow_after = functions[_flow(following)](after, following.controls[0, 0, 0]).full().ravel()
    impact = np.asarray(jacobians(params, reset=reset)(before, u_before)[2])
    gradient = np.array([1.0, 0.0, 0.0, 0.0])  # of the guard phi = b
    return np.asarray(
        impact + np.outer(flow_after - impact @ flow_before, gradient) / flow_before[0]
    )


def step_maps(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> list[Array]:
    """d x(end) / d x(start) of every step, shape (4, 4) each, with the end after the touchdown.

    Within a step the gait's voltage is played back in time. The touchdown itself, early or late,
    switches to the voltage of the following step. (If the clock switched it, early and late
    touchdowns would have different matrices.)
    """
    pairs = zip(phases, [*phases[1:], phases[0]], strict=True)
    return [saltation(params, *pair) @ transition(params, pair[0]) for pair in pairs]


def monodromy(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> Array:
    """d x(T) / d x(0) over a stride, shape (4, 4): the product of `step_maps`."""
    total = np.eye(4)
    for step in step_maps(params, phases):
        total = step @ total
    return total


def floquet_multipliers(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> Array:
    """Eigenvalues of `monodromy`, largest first, complex, shape (4,).

    They are those of the gait in open loop, as `monodromy` defines it. All four matter: since the
    voltage is a function of time, no direction is neutral.
    """
    values = np.linalg.eigvals(monodromy(params, phases)).astype(complex)
    return np.asarray(values[np.argsort(-np.abs(values), kind="stable")])
