"""Solve every textbook problem and print a table: known answer, found, mesh, error."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from typing import Any

import casadi as ca

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt import Extremal, Linkage, Mesh, Phase, Problem, solve
from trajopt.ocp.schemes import SCHEMES
from trajopt.ocp.textbook import EXAMPLES, Example


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
    return WheelParams(
        n_legs=legs,
        slope=slope,
        wheel_inertia=0.0,
        pendulum_length=0.0,
        pendulum_inertia=0.1,
        motor_constant=0.0,
    )


PASSIVE_WHEEL = Example(passive_wheel, passive_wheel_rate)

PROBLEMS = (*EXAMPLES, PASSIVE_WHEEL)

HEADER = """\
| problem | known | found | error | mesh | runs | states' error | Hamiltonian |
| --- | --- | --- | --- | --- | --- | --- | --- |"""


def row(example: Example, found: Extremal) -> str:
    """One line of the table."""
    known = example.known()
    elements = "+".join(str(len(degrees)) for degrees in found.mesh.degrees)
    degrees = sorted({degree for phase in found.mesh.degrees for degree in phase})
    cells = (
        example.name,
        f"{known:.10g}",
        f"{found.cost:.10g}",
        f"{abs(found.cost - known) / abs(known):.0e}",
        f"{elements} of degree {degrees[0]}" + (f" to {degrees[-1]}" if len(degrees) > 1 else ""),
        str(len(found.attempts)),
        f"{found.mesh_error:.0e}" if found.converged else f"**{found.failures[0]}**",
        f"{found.certificate.hamiltonian_spread:.0e}",
    )
    return f"| {' | '.join(cells)} |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 0 if all converged, 1 if not."""
    parser = argparse.ArgumentParser(description=__doc__)
    names = [example.problem.__name__ for example in PROBLEMS]
    parser.add_argument("problems", nargs="*", help=f"of {', '.join(names)}; all by default")
    parser.add_argument("--scheme", choices=SCHEMES, default="radau", help="transcription")
    parser.add_argument("--elements", type=int, default=10, help="per phase, to begin with")
    parser.add_argument("--degree", type=int, default=4, help="of radau, to begin with")
    parser.add_argument("--tolerance", type=float, default=1e-7, help="of the mesh")
    options = parser.parse_args(arguments)
    unknown = set(options.problems) - set(names)
    if unknown:
        parser.error(f"unknown problems: {', '.join(sorted(unknown))}")
    print(HEADER)
    converged = True
    for example in PROBLEMS:
        if options.problems and example.problem.__name__ not in options.problems:
            continue
        problem = example.problem()
        mesh = Mesh.uniform(problem, options.elements, options.degree, options.scheme)
        found = solve(problem, mesh=mesh, tolerance=options.tolerance)
        print(row(example, found), flush=True)
        converged = converged and found.converged
    return 0 if converged else 1
