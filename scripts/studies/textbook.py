"""Solve every textbook problem and print a table: known answer, found, mesh, error."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from trajopt import Extremal, Mesh, solve
from trajopt.gaits.problem import PASSIVE_WHEEL
from trajopt.ocp.schemes import SCHEMES
from trajopt.ocp.textbook import EXAMPLES, Example

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
