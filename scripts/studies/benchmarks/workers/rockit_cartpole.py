"""rockit on the cart-pole, with the settings with which it is fastest."""

from __future__ import annotations

import time
from importlib.metadata import version
from typing import Any

import casadi as ca
from rockit import DirectCollocation, MultipleShooting, Ocp  # type: ignore[import-not-found]

from .. import cartpole
from ..protocol import Measure, serve

OPTIONS = {"expand": True, "print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
OPTIONS |= {"detect_simple_bounds": True}


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Each repetition builds an `Ocp` and solves it twice.

    rockit makes its solver within the first solve. The time by which that takes longer than the
    second solve counts as building.
    """
    method = settings["method"]

    def measure(seconds: float) -> dict[str, Any]:
        return cartpole.repeated(lambda: once(method), seconds)

    return measure, {"version": f"rockit-meco {version('rockit-meco')}"}


def once(method: str) -> dict[str, float]:
    """Build and solve."""
    begin = time.perf_counter()
    ocp, cost = build(method)
    ocp.solve()
    first = time.perf_counter()
    solution = ocp.solve()
    solve = time.perf_counter() - first
    return {
        "build": first - begin - solve,
        "solve": solve,
        "iterations": solution.stats["iter_count"],
        "cost": float(solution.value(cost)),
    }


def build(method: str) -> tuple[Any, Any]:
    """The problem and its cost. The force is linear within a segment."""
    ocp = Ocp(T=cartpole.DURATION)
    x, u = ocp.state(4), ocp.control(order=1)
    ocp.set_der(x, ca.vertcat(*cartpole.derivative(ca.vertsplit(x), u, ca.sin, ca.cos)))
    cost = ocp.integral(u**2)
    ocp.add_objective(cost)
    ocp.subject_to(ocp.at_t0(x) == ca.DM(cartpole.START))
    ocp.subject_to(ocp.at_tf(x) == ca.DM(cartpole.END))
    for signal, bound in ((u, cartpole.FORCE), (x[0], cartpole.TRACK)):
        ocp.subject_to(-bound <= (signal <= bound))
    ocp.set_initial(x, ca.vertcat(*cartpole.line(ocp.t / cartpole.DURATION)))
    ocp.solver("ipopt", OPTIONS)
    if method == "collocation":
        ocp.method(DirectCollocation(N=cartpole.SEGMENTS, degree=2, scheme="legendre"))
    else:
        ocp.method(MultipleShooting(N=cartpole.SEGMENTS, intg="rk"))
    return ocp, cost


if __name__ == "__main__":
    serve(setup)
