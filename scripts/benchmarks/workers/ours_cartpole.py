"""Our engine on the cart-pole."""

from __future__ import annotations

import time
from typing import Any

from trajopt.textbook import cart_pole  # type: ignore[import-not-found]

from scripts.benchmarks import cartpole
from scripts.benchmarks.protocol import Measure, serve
from trajopt import Mesh, solve  # type: ignore[attr-defined]


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """A repetition builds the problem and solves it on one mesh."""
    return lambda seconds: cartpole.repeated(once, seconds), {"version": "rimless-gym"}


def once() -> dict[str, float]:
    """Build and solve."""
    begin = time.perf_counter()
    problem = cart_pole()
    mesh = Mesh.uniform(problem, elements=cartpole.SEGMENTS, scheme="hermite-simpson")
    solution = solve(problem, mesh=mesh, refine=False)
    elapsed = time.perf_counter() - begin
    return {
        "build": elapsed - solution.seconds,
        "solve": solution.seconds,
        "iterations": solution.iterations,
        "cost": solution.cost,
    }


if __name__ == "__main__":
    serve(setup)
