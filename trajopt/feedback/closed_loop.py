"""The linear dynamics of a law on its gait: what a stride makes of a deviation across the orbit."""

from __future__ import annotations

import numpy as np

from trajopt.feedback.law import Floats, Law
from trajopt.feedback.orbit import FINENESS, Grid
from trajopt.feedback.requirements import require_machine
from trajopt.feedback.transverse import DIFFERENCE, transverse_dynamics
from trajopt.gaits.solution import Solution


def multipliers(law: Law, solution: Solution) -> Floats:
    """Sizes of the multipliers of a stride across the orbit, at 100 Hz, largest first, shape (3,).

    The law is differentiated at one state of every control period, and the stride goes from one of
    these states to the next (`trajopt.feedback.transverse`). The wheel is taken to be in step with
    the gait at every decision: a deviation makes it early or late, which under a hold comes back as
    a small deviation, and that is left out. Which sign it has depends on where the touchdown falls
    between two decisions.

    Raises:
        TypeError: `solution` is not a `trajopt.Solution`.
        ValueError: it failed its verification, or the law is for another machine.
    """
    grid = Grid.of(solution)
    require_machine("law", law, solution.params)
    A, B, into = transverse_dynamics(grid)
    out = np.linalg.inv(into)
    product = np.eye(3)
    for j in range(0, len(A), FINENESS):
        nudges = DIFFERENCE * out[j].T[:3]
        volts = law(np.concatenate([grid.states[j] + nudges, grid.states[j] - nudges]))
        slopes = (volts[:3] - volts[3:]) / (2 * DIFFERENCE)
        product = (A[j, :3, :3] + B[j, :3] * slopes) @ product
    return np.asarray(np.sort(np.abs(np.linalg.eigvals(product)))[::-1])
