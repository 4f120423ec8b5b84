"""Drake's direct collocation (Hermite-Simpson) on the cart-pole, with one of its solvers.

The system is symbolic, which is several times as fast as Drake's multibody plant of the same
machine.
"""

from __future__ import annotations

import re
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.planning import DirectCollocation
from pydrake.solvers import CommonSolverOption, IpoptSolver, SnoptSolver, SolverOptions
from pydrake.symbolic import Variable, cos, sin
from pydrake.systems.primitives import SymbolicVectorSystem
from pydrake.trajectories import PiecewisePolynomial

from .. import cartpole
from ..protocol import Measure, serve

SOLVERS = {"ipopt": IpoptSolver, "snopt": SnoptSolver}

#: The line of their reports that has the number of iterations.
ITERATIONS = r"(?:Number of Iterations\.+:|No\. of major iterations) *(\d+)"


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Each repetition builds the program and solves it once."""
    solver = SOLVERS[settings["solver"]]()
    iterations = count(solver)

    def once() -> dict[str, float]:
        begin = time.perf_counter()
        collocation = build()
        built = time.perf_counter()
        result = solver.Solve(collocation.prog())
        return {
            "build": built - begin,
            "solve": time.perf_counter() - built,
            "iterations": iterations,
            "cost": result.get_optimal_cost() if result.is_success() else np.nan,
        }

    about = {"version": f"drake {version('drake')}"}
    return lambda seconds: cartpole.repeated(once, seconds), about


def build() -> DirectCollocation:
    """The mathematical program."""
    x, u = [Variable(name) for name in ("q1", "q2", "v1", "v2")], Variable("u")
    system = SymbolicVectorSystem(
        state=x, input=[u], output=x, dynamics=cartpole.derivative(x, u, sin, cos)
    )
    h = cartpole.DURATION / cartpole.SEGMENTS
    collocation = DirectCollocation(
        system, system.CreateDefaultContext(), cartpole.SEGMENTS + 1, h, h
    )
    prog, end = collocation.prog(), [0.0, cartpole.DURATION]
    for k in range(cartpole.SEGMENTS + 1):
        prog.AddBoundingBoxConstraint(-cartpole.FORCE, cartpole.FORCE, collocation.input(k))
        prog.AddBoundingBoxConstraint(-cartpole.TRACK, cartpole.TRACK, collocation.state(k)[0])
    for at, state in (
        (cartpole.START, collocation.initial_state()),
        (cartpole.END, collocation.final_state()),
    ):
        prog.AddBoundingBoxConstraint(at, at, state)
    collocation.AddRunningCost(collocation.input()[0] ** 2)
    collocation.SetInitialTrajectory(
        PiecewisePolynomial.FirstOrderHold(end, np.zeros((1, 2))),
        PiecewisePolynomial.FirstOrderHold(end, np.transpose([cartpole.line(0), cartpole.line(1)])),
    )
    return collocation


def count(solver: Any) -> int:
    """The solver's iterations, from its own report."""
    with tempfile.TemporaryDirectory() as folder:
        path, options = Path(folder) / "report", SolverOptions()
        options.SetOption(CommonSolverOption.kPrintFileName, str(path))
        options.SetOption(SnoptSolver.id(), "Major print level", 1)
        solver.Solve(build().prog(), None, options)
        return int(re.findall(ITERATIONS, path.read_text())[-1])


if __name__ == "__main__":
    serve(setup)
