"""One element of a discretised phase: its equations and its cost."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from trajopt.ocp.arrays import Indices
from trajopt.ocp.pose.phase import Phase
from trajopt.ocp.transcribe.schemes import Scheme


def element(phase: Phase, scheme: Scheme, parameters: int) -> ca.Function:
    """The element's equations and cost: (v, width) -> (outputs, cost).

    v consists of the states at the left edge (nx), inside (nx (n - 2)) and at the right edge (nx),
    the controls (nu m), slacks (k w), the phase's duration, and p. The width is a fraction of that
    duration. The outputs are, in this order: defects (nx r), path constraints at `path_nodes`,
    slacks less powers (k w), integrals.
    """
    constraints = (c and c.function for c in (phase.path, phase.integral))
    functions = (phase.flow, phase.cost, phase.powers, *constraints)
    sizes = len(phase.states), len(phase.controls), parameters
    return _element(sizes, functions, scheme)


@lru_cache(maxsize=64)  # refinement needs the same ones again
def _element(
    sizes: tuple[int, int, int], functions: tuple[Any, ...], scheme: Scheme
) -> ca.Function:
    (nx, nu, parameters), (flow, running, power, path, integrand) = sizes, functions
    n, m = len(scheme.nodes), len(scheme.control_nodes)
    weighted, collocated = scheme.weighted, scheme.collocated
    k = power.size1_out(0) if power else 0
    counts = [nx, nx * (n - 2), nx, nu * m, k * len(weighted), 1, parameters]
    v, width = ca.SX.sym("v", sum(counts)), ca.SX.sym("width")
    cuts = np.cumsum([0, *counts]).tolist()
    left, interior, right, coefficients, slacks, duration, p = ca.vertsplit(v, cuts)
    h = width * duration
    X = ca.horzcat(left, ca.reshape(interior, nx, n - 2), right)
    U = ca.reshape(coefficients, nu, m) @ ca.DM(scheme.control_basis).T

    def at(function: Any, nodes: Indices) -> ca.SX:
        return ca.horzcat(*(function(X[:, int(j)], U[:, int(j)], p) for j in nodes))

    F = at(flow, collocated)
    defects = X @ ca.DM(scheme.D).T - h * (F @ ca.DM(scheme.A[:, collocated]).T)
    b = ca.DM(scheme.quadrature[weighted])
    cost, outputs = ca.SX(0), [ca.vec(defects)]
    if path:
        outputs.append(ca.vec(at(path, path_nodes(scheme))))
    if running:
        cost += h * (at(running, weighted) @ b)
    if power:
        paid = ca.reshape(slacks, k, len(weighted))
        outputs.append(ca.vec(paid - at(power, weighted)))
        cost += h * ca.sum1(paid @ b)
    if integrand:
        outputs.append(h * (at(integrand, weighted) @ b))
    return ca.Function("element", [v, width], [ca.densify(ca.vertcat(*outputs)), cost])


def path_nodes(scheme: Scheme) -> Indices:
    """Nodes at which an element imposes path constraints.

    Where controls are shared, an element's right end is left to its neighbour. Where they are not,
    the control has two limits at an edge, and both elements impose the constraint.
    """
    n = len(scheme.nodes)
    return np.arange(n - 1 if scheme.shared_controls else n)


def powers(phase: Phase) -> int:
    """How many powers a traced phase pays for."""
    return phase.powers.size1_out(0) if isinstance(phase.powers, ca.Function) else 0
