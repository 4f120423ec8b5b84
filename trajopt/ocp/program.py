"""A nonlinear program that is a sum of small blocks, with its exact sparse derivatives.

    minimise  f(w) = sum of cost(v, d)    subject to  lower <= g(w) = sum of outputs(v, d) <= upper

A block is one function, applied `count` times to columns of variables v, picked out of w, and of
constants d. Each time its outputs are added to rows of g. The function is differentiated once, and
its derivatives are added to those of the program as a finite element code adds element matrices.
This is two to three times faster, to build and to solve, than differentiating the whole program.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from trajopt.ocp.arrays import Array, Indices


@dataclasses.dataclass(frozen=True)
class Block:
    """One function applied many times."""

    function: ca.Function  # (v, d) -> (outputs, cost), traced with SX symbols
    variables: Indices  # indices into w, shape (len(v), count)
    rows: Indices  # indices into g, shape (len(outputs), count)
    data: Array  # the constants, shape (len(d), count)

    @property
    def count(self) -> int:
        """How many times it is applied."""
        return self.variables.shape[1]


@dataclasses.dataclass(frozen=True)
class Program:
    """A nonlinear program as `casadi.nlpsol` takes it."""

    # of the unknowns "x", the parameters "p" (none but scales), the cost "f" and the constraints
    # "g"
    symbols: dict[str, Any]
    # functions of x, p and the multipliers of f and g, by name: "grad_f", "jac_g" and "hess_lag"
    # (the upper triangle); options of `casadi.nlpsol`
    derivatives: dict[str, ca.Function]


def assembled(blocks: Sequence[Block], size: int, rows: int) -> Program:
    """The program that is the sum of these blocks, with so many unknowns and rows of g."""
    w, lam_f, lam_g = ca.MX.sym("x", size), ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows)
    none = ca.MX.sym("p", 0)
    f, g, gradient, J, H = ca.MX(0), [], [], [], []
    for block in blocks:
        parts = _differentiated(block.function)
        v, d = _picked(w, block.variables), ca.DM(block.data)
        outputs = parts.outputs.map(block.count)(v, d)
        weights = _picked(lam_g, block.rows), ca.repmat(lam_f, 1, block.count)
        f += ca.sum2(parts.cost.map(block.count)(v, d))
        g.append((block.rows, outputs))
        entries = parts.gradient.map(block.count)(v, d)
        gradient.append((block.variables[parts.gradient_at], entries))
        i, j = parts.jacobian_at
        entries = parts.jacobian.map(block.count)(v, d)
        J.append((block.rows[i], block.variables[j], entries))
        i, j = (block.variables[k] for k in parts.hessian_at)
        entries = parts.hessian.map(block.count)(v, d, *weights)
        H.append((np.minimum(i, j), np.maximum(i, j), entries))  # the upper triangle
    values = _added(g, rows)
    oracles: dict[str, tuple[list[ca.MX], dict[str, ca.MX]]] = {
        "grad_f": ([w, none], {"f": f, "grad_f_x": _added(gradient, size)}),
        "jac_g": ([w, none], {"g": values, "jac_g_x": _matrix(J, (rows, size))}),
        "hess_lag": ([w, none, lam_f, lam_g], {"hess_gamma_x_x": _matrix(H, (size, size))}),
    }
    return Program({"x": w, "p": none, "f": f, "g": values}, _functions(oracles))


def scaled(program: Program) -> Program:
    """The program in other units, which are its parameters "p".

    These are the scales of the unknowns, of the constraints and of the cost, one after the other:
    the new numbers are the old ones over their scales.
    """
    old, given = program.symbols, program.derivatives
    size, rows = old["x"].numel(), old["g"].numel()
    x, p = ca.MX.sym("x", size), ca.MX.sym("p", size + rows + 1)
    of_x, of_g, of_f = ca.vertsplit(p, [0, size, size + rows, size + rows + 1])
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", rows)
    w = of_x * x
    f, gradient = given["grad_f"](w, old["p"])
    g, jacobian = given["jac_g"](w, old["p"])
    hessian = given["hess_lag"](w, old["p"], lam_f / of_f, lam_g / of_g)
    oracles: dict[str, tuple[list[ca.MX], dict[str, ca.MX]]] = {
        "grad_f": ([x, p], {"f": f / of_f, "grad_f_x": of_x * gradient / of_f}),
        "jac_g": ([x, p], {"g": g / of_g, "jac_g_x": _weighted(jacobian, 1 / of_g, of_x)}),
        "hess_lag": ([x, p, lam_f, lam_g], {"hess_gamma_x_x": _weighted(hessian, of_x, of_x)}),
    }
    f, g = ca.graph_substitute([old["f"], old["g"]], [old["x"]], [w])
    return Program({"x": x, "p": p, "f": f / of_f, "g": g / of_g}, _functions(oracles))


def _weighted(matrix: ca.MX, rows: ca.MX, columns: ca.MX) -> ca.MX:
    """The matrix with its rows and columns multiplied by weights."""
    i, j = matrix.sparsity().get_triplet()
    return ca.MX(matrix.sparsity(), matrix.nz[:] * rows[i] * columns[j])


def _functions(
    oracles: Mapping[str, tuple[list[ca.MX], dict[str, ca.MX]]],
) -> dict[str, ca.Function]:
    """The functions that `casadi.nlpsol` takes as options, by name."""
    names = ["x", "p", "lam_f", "lam_g"]
    return {
        name: ca.Function(name, inputs, list(out.values()), names[: len(inputs)], list(out))
        for name, (inputs, out) in oracles.items()
    }


def _picked(w: ca.MX, where: Indices) -> ca.MX:
    return ca.reshape(w[where.ravel(order="F").tolist()], *where.shape)


@dataclasses.dataclass(frozen=True)
class _Derivatives:
    """A block's function and its derivatives: their nonzeros as columns, and where these are.

    The functions take (v, d); the Hessian also takes the outputs' and the cost's multipliers.
    """

    outputs: ca.Function
    cost: ca.Function
    gradient: ca.Function
    jacobian: ca.Function
    hessian: ca.Function
    gradient_at: Indices
    jacobian_at: tuple[Indices, Indices]
    hessian_at: tuple[Indices, Indices]


@lru_cache(maxsize=64)  # refinement needs the same ones again
def _differentiated(function: ca.Function) -> _Derivatives:
    v, d = function.sx_in()
    outputs, cost = function(v, d)
    mu, weight = ca.SX.sym("mu", outputs.numel()), ca.SX.sym("weight")
    jacobian = ca.jacobian(outputs, v)
    lagrangian = weight * cost + ca.dot(mu, outputs)
    hessian = ca.triu(ca.hessian(lagrangian, v)[0])
    gradient = ca.gradient(cost, v)
    return _Derivatives(
        outputs=ca.Function("outputs", [v, d], [outputs]),
        cost=ca.Function("cost", [v, d], [cost]),
        gradient=ca.Function("gradient", [v, d], [_nonzeros(gradient)]),
        jacobian=ca.Function("jacobian", [v, d], [_nonzeros(jacobian)]),
        hessian=ca.Function("hessian", [v, d, mu, weight], [_nonzeros(hessian)]),
        gradient_at=_places(gradient)[0],
        jacobian_at=_places(jacobian),
        hessian_at=_places(hessian),
    )


def _nonzeros(matrix: ca.SX) -> ca.SX:
    return ca.SX(matrix.nz[:])


def _places(matrix: ca.SX) -> tuple[Indices, Indices]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=np.intp), np.array(columns, dtype=np.intp)


def _added(parts: Sequence[tuple[Indices, ca.MX]], size: int) -> ca.MX:
    """A dense vector to which values are added at indices."""
    where = np.concatenate([places.ravel(order="F") for places, _ in parts])
    values = ca.vertcat(*(ca.vec(v) for _, v in parts))
    return ca.densify(_summed(where, size) @ values)


def _matrix(parts: Sequence[tuple[Indices, Indices, ca.MX]], shape: tuple[int, int]) -> ca.MX:
    """A sparse matrix from entries that are added where they coincide."""
    rows = np.concatenate([i.ravel(order="F") for i, _, _ in parts])
    columns = np.concatenate([j.ravel(order="F") for _, j, _ in parts])
    places, where = np.unique(columns * shape[0] + rows, return_inverse=True)
    column, row = np.divmod(places, shape[0])
    sparsity = ca.Sparsity.triplet(*shape, row.tolist(), column.tolist())
    values = ca.vertcat(*(ca.vec(v) for _, _, v in parts))
    return ca.MX(sparsity, _summed(where, len(places)) @ values)


def _summed(where: Indices, size: int) -> ca.DM:
    """The matrix of ones that adds entry k of a vector to element where[k]."""
    order = np.arange(len(where))
    ones = ca.DM.ones(len(where))
    return ca.DM.triplet(where.tolist(), order.tolist(), ones, size, len(where))
