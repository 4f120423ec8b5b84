"""Kelly's cart-pole swing-up by other people's tools: `python swing_up.py SETTINGS`, one answer.

M. Kelly, An Introduction to Trajectory Optimization, SIAM Review 59 (2017), section 6: the pole
swings from rest below to rest above in 2 s while the cart moves by 1 m, with the least integral of
the squared force. Every tool uses 40 segments, and guesses a straight line between the ends, with
rates and force 0. Each tool runs in a virtual environment of its own, so this file imports only
what it measures.
"""

import json
import math
import re
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

#: Masses (kg) of cart and pole, length of the pole (m), gravity (m/s^2).
CART, POLE, LENGTH, GRAVITY = 1.0, 0.3, 0.5, 9.81

#: Largest force (N), largest distance of the cart from its start (m), and duration (s).
FORCE, TRACK, DURATION = 20.0, 2.0, 2.0

#: Position of the cart (m), angle of the pole from below (rad), and their rates.
START, END = (0.0, 0.0, 0.0, 0.0), (1.0, math.pi, 0.0, 0.0)

SEGMENTS = 40

#: The least cost (N^2 s), and by which share of it other discretisations may differ.
COST, TOLERANCE = 58.81, 0.03

IPOPT: dict[str, Any] = {
    "expand": True,
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
}


class Tool(NamedTuple):
    """A tool that builds and solves the problem."""

    package: str  # that is installed
    build: Callable[[], Any]  # makes the problem and its solver
    # solves what `build` made; returns the number of iterations and the cost (N^2 s)
    solve: Callable[[Any], tuple[float, float]]
    solves_to_build: int = 0  # within `build`; their time does not count


def main() -> None:
    """Solve with the tool that the settings name again and again, and print medians as JSON."""
    settings = json.loads(sys.argv[1])
    tool = TOOLS[settings["measure"]]()
    answer = repeated(tool, settings["seconds"])
    print(json.dumps(answer | {"version": f"{tool.package} {version(tool.package)}"}))


def repeated(tool: Tool, seconds: float) -> dict[str, Any]:
    """Build and solve again and again until the time (s) is over.

    Returns:
        The number of repetitions (`steps`), the time that they took (`seconds`), and medians: times
        (s) to `build`, to `solve` and of both (`total`), `iterations` and `cost`.

    Raises:
        RuntimeError: no optimum was found, or a different one.
    """
    answers: list[dict[str, float]] = []
    begin = time.perf_counter()
    while (elapsed := time.perf_counter() - begin) < seconds or not answers:
        started = time.perf_counter()
        problem = tool.build()
        built = time.perf_counter()
        iterations, cost = tool.solve(problem)
        solve = time.perf_counter() - built
        if not abs(cost - COST) <= TOLERANCE * COST:
            raise RuntimeError(f"a cost of {cost:.4g} N^2 s instead of {COST}")
        build = built - started - tool.solves_to_build * solve
        times = {"build": build, "solve": solve, "total": build + solve}
        answers.append(times | {"iterations": iterations, "cost": cost})
    medians = {name: median(answer[name] for answer in answers) for name in answers[0]}
    return {"steps": len(answers), "seconds": elapsed} | medians


def derivative(
    x: Sequence[Any], u: Any, sin: Callable[[Any], Any], cos: Callable[[Any], Any]
) -> Any:
    """The rates of change of a state `x` under a force `u`, as a list, for any type of number."""
    s, c = sin(x[1]), cos(x[1])
    inertia, push = CART + POLE * s**2, u + LENGTH * POLE * s * x[3] ** 2
    cart = (push + POLE * GRAVITY * s * c) / inertia
    pole = -(push * c + (CART + POLE) * GRAVITY * s) / (LENGTH * inertia)
    return [x[2], x[3], cart, pole]


def line(part: float) -> list[float]:
    """The guess of the state after a part (0 to 1) of the time: on a straight line, rates 0."""
    return [part * END[0], part * END[1], 0.0, 0.0]


def casadi_script() -> Tool:
    """By hand: separated Hermite-Simpson with CasADi, IPOPT and MUMPS.

    The equations of motion are mapped over all points at once and expanded into scalars. That makes
    derivatives several times as fast, and building slower.
    """
    import casadi as ca
    import numpy as np

    def build() -> tuple[Any, dict[str, Any]]:
        points, h = 2 * SEGMENTS + 1, DURATION / SEGMENTS
        x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
        rates = ca.vertcat(*derivative(ca.vertsplit(x), u, ca.sin, ca.cos))
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
        high[:, 0], high[:, 4] = TRACK, FORCE
        low = -high
        low[0, :4] = high[0, :4] = START
        low[-1, :4] = high[-1, :4] = END
        guess = np.array([[*line(part), 0.0] for part in np.linspace(0, 1, points)])
        nlp: dict[str, Any] = {"x": ca.vec(z), "f": cost, "g": ca.vec(ca.vertcat(middles, ends))}
        solver = ca.nlpsol("solver", "ipopt", nlp, IPOPT)
        bounds = {"lbx": low.ravel(), "ubx": high.ravel(), "lbg": 0, "ubg": 0}
        return solver, {"x0": guess.ravel()} | bounds

    def solve(built: tuple[Any, dict[str, Any]]) -> tuple[float, float]:
        solver, arguments = built
        solution, stats = solver(**arguments), solver.stats()
        return stats["iter_count"], float(solution["f"]) if stats["success"] else math.nan

    return Tool("casadi", build, solve)


def rockit() -> Tool:
    """rockit's collocation, whose force is linear within a segment.

    It makes its solver within the first solve. The time by which that takes longer than a second
    solve counts as building.
    """
    import casadi as ca
    from rockit import DirectCollocation, Ocp  # type: ignore[import-not-found]

    def build() -> tuple[Any, Any]:
        ocp = Ocp(T=DURATION)
        x, u = ocp.state(4), ocp.control(order=1)
        ocp.set_der(x, ca.vertcat(*derivative(ca.vertsplit(x), u, ca.sin, ca.cos)))
        cost = ocp.integral(u**2)
        ocp.add_objective(cost)
        ocp.subject_to(ocp.at_t0(x) == ca.DM(START))
        ocp.subject_to(ocp.at_tf(x) == ca.DM(END))
        for signal, bound in ((u, FORCE), (x[0], TRACK)):
            ocp.subject_to(-bound <= (signal <= bound))
        ocp.set_initial(x, ca.vertcat(*line(ocp.t / DURATION)))
        ocp.solver("ipopt", IPOPT | {"detect_simple_bounds": True})
        ocp.method(DirectCollocation(N=SEGMENTS, degree=2, scheme="legendre"))
        ocp.solve()
        return ocp, cost

    def solve(built: tuple[Any, Any]) -> tuple[float, float]:
        ocp, cost = built
        solution = ocp.solve()
        return solution.stats["iter_count"], float(solution.value(cost))

    return Tool("rockit-meco", build, solve, solves_to_build=1)


def drake() -> Tool:
    """Drake's Hermite-Simpson and IPOPT, on a symbolic system: a multibody plant is slower."""
    import numpy as np
    from pydrake.planning import DirectCollocation
    from pydrake.solvers import CommonSolverOption, IpoptSolver, SolverOptions
    from pydrake.symbolic import Variable, cos, sin
    from pydrake.systems.primitives import SymbolicVectorSystem
    from pydrake.trajectories import PiecewisePolynomial

    ipopt = IpoptSolver()

    def build() -> Any:
        x, u = [Variable(name) for name in ("q1", "q2", "v1", "v2")], Variable("u")
        system = SymbolicVectorSystem(
            state=x, input=[u], output=x, dynamics=derivative(x, u, sin, cos)
        )
        h = DURATION / SEGMENTS
        collocation = DirectCollocation(system, system.CreateDefaultContext(), SEGMENTS + 1, h, h)
        program = collocation.prog()
        for k in range(SEGMENTS + 1):
            program.AddBoundingBoxConstraint(-FORCE, FORCE, collocation.input(k))
            program.AddBoundingBoxConstraint(-TRACK, TRACK, collocation.state(k)[0])
        program.AddBoundingBoxConstraint(START, START, collocation.initial_state())
        program.AddBoundingBoxConstraint(END, END, collocation.final_state())
        collocation.AddRunningCost(collocation.input()[0] ** 2)
        ends = [0.0, DURATION]
        collocation.SetInitialTrajectory(
            PiecewisePolynomial.FirstOrderHold(ends, np.zeros((1, 2))),
            PiecewisePolynomial.FirstOrderHold(ends, np.transpose([line(0), line(1)])),
        )
        return collocation

    options = SolverOptions()
    with tempfile.NamedTemporaryFile() as report:  # only IPOPT's own report has the iterations
        options.SetOption(CommonSolverOption.kPrintFileName, report.name)
        ipopt.Solve(build().prog(), None, options)
        text = Path(report.name).read_text()
    iterations = int(re.findall(r"Number of Iterations\.+: *(\d+)", text)[-1])

    def solve(collocation: Any) -> tuple[float, float]:
        result = ipopt.Solve(collocation.prog())
        return iterations, result.get_optimal_cost() if result.is_success() else math.nan

    return Tool("drake", build, solve)


TOOLS = {"casadi": casadi_script, "rockit": rockit, "drake": drake}

if __name__ == "__main__":
    main()
