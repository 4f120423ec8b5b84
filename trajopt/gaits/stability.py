"""Linearisation of a gait: phase transition, saltation at touchdowns, Floquet multipliers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt.ocp.arrays import Array
from trajopt.ocp.schemes import differentiation_matrix, radau_nodes
from trajopt.ocp.trajectory import PhaseTrajectory


@lru_cache(maxsize=8)
def jacobians(params: WheelParams) -> ca.Function:
    """(x, u) -> (A, B, G): derivatives of the flow by x and u, and of the touchdown by x."""
    model = HybridModel(params)
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    flow, touchdown = model.flow(x, u), model.touchdown(x)
    outputs = [ca.jacobian(flow, x), ca.jacobian(flow, u), ca.jacobian(touchdown, x)]
    return ca.Function("jacobians", [x, u], outputs)


def transition(params: WheelParams, phase: PhaseTrajectory, degree: int = 8) -> Array:
    """d x(end) / d x(start) over one phase, with times and control fixed, shape (4, 4).

    The variational equation, collocated on the phase's own elements.
    """
    derivatives, nodes = jacobians(params), radau_nodes(degree)
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


def saltation(params: WheelParams, before: Array, u_before: float, u_after: float) -> Array:
    """How a touchdown maps a deviation at a fixed time, shape (4, 4).

    A deviation moves the touchdown in time as well as the state that it maps (Leine and
    Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, 7.2).
    """
    model = HybridModel(params)
    flow_before = np.asarray(model.flow(before, u_before)).ravel()
    after = np.asarray(model.touchdown(before)).ravel()
    flow_after = np.asarray(model.flow(after, u_after)).ravel()
    impact = np.asarray(jacobians(params)(before, u_before)[2])
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
    maps = []
    for phase, following in zip(phases, [*phases[1:], phases[0]], strict=True):
        u_before = phase.control([phase.duration], "left")[0, 0]
        u_after = following.controls[0, 0, 0]
        jump = saltation(params, phase.end, float(u_before), float(u_after))
        maps.append(jump @ transition(params, phase))
    return maps


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
