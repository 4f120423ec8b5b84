#!/usr/bin/env python
"""Solve every textbook problem and print a table: known answer, found, mesh, error."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from trajopt import Extremal, Mesh, solve
from trajopt.mesh import SCHEMES
from trajopt.textbook import EXAMPLES, Example

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


def main() -> int:
    """Run the command line; 0 if all converged, 1 if not."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    names = [example.problem.__name__ for example in EXAMPLES]
    parser.add_argument("problems", nargs="*", help=f"of {', '.join(names)}; all by default")
    parser.add_argument("--scheme", choices=SCHEMES, default="radau", help="transcription")
    parser.add_argument("--elements", type=int, default=10, help="per phase, to begin with")
    parser.add_argument("--degree", type=int, default=4, help="of radau, to begin with")
    parser.add_argument("--tolerance", type=float, default=1e-7, help="of the states' error")
    options = parser.parse_args()
    unknown = set(options.problems) - set(names)
    if unknown:
        parser.error(f"unknown problems: {', '.join(sorted(unknown))}")
    print(HEADER)
    converged = True
    for example in EXAMPLES:
        if options.problems and example.problem.__name__ not in options.problems:
            continue
        problem = example.problem()
        mesh = Mesh.uniform(problem, options.elements, options.degree, options.scheme)
        found = solve(problem, mesh=mesh, tolerance=options.tolerance)
        print(row(example, found), flush=True)
        converged = converged and found.converged
    return 0 if converged else 1


if __name__ == "__main__":
    sys.exit(main())
