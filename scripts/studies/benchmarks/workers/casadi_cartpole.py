"""The cart-pole by hand, with CasADi, IPOPT and MUMPS: the script that tools are compared with.

It uses separated Hermite-Simpson: states and forces in the middle of a segment are variables too.
The equations of motion are mapped over all points at once and expanded into scalars. That makes
derivatives several times as fast, and building slower.
"""

from __future__ import annotations

import time
from importlib.metadata import version
from typing import Any

import casadi as ca
import numpy as np

from .. import cartpole
from ..protocol import Measure, serve

OPTIONS: dict[str, Any] = {
    "expand": True,
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
}


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Each repetition builds the solver and solves once."""
    return lambda seconds: cartpole.repeated(once, seconds), {
        "version": f"casadi {version('casadi')}"
    }


def once() -> dict[str, float]:
    """Build and solve."""
    begin = time.perf_counter()
    solver, arguments = build()
    built = time.perf_counter()
    solution = solver(**arguments)
    return {
        "build": built - begin,
        "solve": time.perf_counter() - built,
        "iterations": solver.stats()["iter_count"],
        "cost": float(solution["f"]) if solver.stats()["success"] else np.nan,
    }


def build() -> tuple[Any, dict[str, Any]]:
    """The solver and its arguments."""
    points, h = 2 * cartpole.SEGMENTS + 1, cartpole.DURATION / cartpole.SEGMENTS
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    rates = ca.vertcat(*cartpole.derivative(ca.vertsplit(x), u, ca.sin, ca.cos))
    z = ca.MX.sym("z", 5, points)
    xs, us = z[:4, :], z[4, :]
    fs = ca.Function("f", [x, u], [rates]).map(points)(xs, us)
    x0, xm, x1 = xs[:, :-1:2], xs[:, 1::2], xs[:, 2::2]
    f0, fm, f1 = fs[:, :-1:2], fs[:, 1::2], fs[:, 2::2]
    middles = xm - (x0 + x1) / 2 - h / 8 * (f0 - f1)
    ends = x1 - x0 - h / 6 * (f0 + 4 * fm + f1)
    weights = np.full(points, 2.0)
    weights[1::2], weights[[0, -1]] = 4.0, 1.0
    cost = ca.mtimes(us**2, ca.DM(h / 6 * weights))
    high = np.full((points, 5), np.inf)
    high[:, 0], high[:, 4] = cartpole.TRACK, cartpole.FORCE
    low = -high
    low[0, :4] = high[0, :4] = cartpole.START
    low[-1, :4] = high[-1, :4] = cartpole.END
    guess = np.array([[*cartpole.line(part), 0.0] for part in np.linspace(0, 1, points)])
    nlp: dict[str, Any] = {"x": ca.vec(z), "f": cost, "g": ca.vec(ca.vertcat(middles, ends))}
    solver = ca.nlpsol("solver", "ipopt", nlp, OPTIONS)
    bounds = {"lbx": low.ravel(), "ubx": high.ravel(), "lbg": 0, "ubg": 0}
    return solver, {"x0": guess.ravel()} | bounds


if __name__ == "__main__":
    serve(setup)
