"""hp mesh refinement: higher degrees where the solution is smooth, more elements where it is not.

After Patterson, Hager and Rao, A ph mesh refinement method for optimal control, Optim. Control
Appl. Methods 36 (2015), with splits at the control's own switches.

No decision depends on rounding or on digits that a solver leaves open, because these differ between
processors. Thresholds are therefore moved off zero, off ties and off round numbers.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.judge.accuracy import Quality
from trajopt.ocp.pose.phase import Phase
from trajopt.ocp.pose.problem import Problem
from trajopt.ocp.solving.switches import breaks, is_smooth, switch_points
from trajopt.ocp.solving.ties import least_first
from trajopt.ocp.transcribe.mesh import FIXED_DEGREE, Mesh
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: What refinement never exceeds: the degree of an element, and the elements of all phases together.
MAX_DEGREE = 12
MAX_ELEMENTS = 400

#: Elements are split only if they are clearly longer than this fraction of their phase.
SHORTEST = 1e-5

#: The same where only the Hamiltonian asks for it: a control that may switch on still shorter
#: elements exploits the discretisation.
SHORTEST_CERTIFIED = 1e-3

#: What "clearly" means, relative: equal elements differ in width by rounding, and elements of a
#: symmetrical solution differ in error by what a solver leaves open.
CLEARLY, WORSE = 1e-6, 1e-2

#: Path constraints violated by more than this between nodes ask for a finer mesh. Smaller
#: violations are left to margins (`solving.margins`): where a control switches, no mesh is fine
#: enough.
COARSE = 1e-3


@dataclasses.dataclass(frozen=True)
class Tolerances:
    """What a mesh has to meet.

    Attributes:
        states: largest relative error of the states within an element.
        cost: largest error of the cost within an element, relative to 1 + |cost|.
        limits: largest violation of bounds and path constraints between the nodes.
        hamiltonian: largest relative change of the Hamiltonian over an element.
    """

    states: float = 1e-7
    cost: float = 1e-6
    limits: float = 1e-6
    hamiltonian: float = 1e-3


def refined(
    mesh: Mesh,
    problem: Problem,
    phases: Sequence[PhaseTrajectory],
    p: Array,
    qualities: Sequence[Quality],
    tolerances: Tolerances,
) -> Mesh:
    """A finer mesh where a tolerance is missed; the same mesh if none is, or caps forbid it.

    An element in which the control switches (it jumps and costs too much, a power passes its floor,
    a bound is met or left) is split there. Otherwise, if states and controls are smooth, its degree
    rises by as much as the error asks for; if they are not, or the degree is at its cap, it is
    halved. Where there is no room to split all elements, the worst are split.
    """
    fractions, degrees = [], []
    room, fixed = max(MAX_ELEMENTS - mesh.elements, 0), mesh.scheme in FIXED_DEGREE
    pairs = zip(problem.phases, qualities, strict=True)
    limits = [_limits(phase, quality, tolerances.limits) for phase, quality in pairs]
    misses = [_misses(*each, tolerances) for each in zip(qualities, limits, strict=True)]
    everywhere = [(i, e) for i, each in enumerate(misses) for e in range(len(each))]
    worst = set(least_first(everywhere, lambda at: -misses[at[0]][at[1]], WORSE)[:room])
    for i, (phase, trajectory, quality) in enumerate(
        zip(problem.phases, phases, qualities, strict=True)
    ):
        edges, orders = [0.0], []
        for e, degree in enumerate(mesh.degrees[i]):
            left, right = mesh.fractions[i][e : e + 2]
            excess = max(
                quality.state_error[e] / tolerances.states, quality.cost_error[e] / tolerances.cost
            )
            wasteful = quality.cost_gap[e] > tolerances.cost
            jumps, inside = breaks(trajectory, e) if wasteful else [], []
            if jumps or max(excess, limits[i][e]) > 1.0:
                digits = math.log10(np.clip(excess, 1.0, 1e99))
                raised = degree + max(1, math.ceil(digits - CLEARLY))
                switches = switch_points(phase, trajectory, e, p)
                smooth = not fixed and is_smooth(trajectory, e) and not switches
                if smooth and raised <= MAX_DEGREE and excess > max(1.0, limits[i][e]):
                    degree = raised
                elif _longer(right - left, SHORTEST) and room > 0 and (i, e) in worst:
                    inside = jumps or switches or [0.5]
                    room -= len(inside)
            edges += [left + (right - left) * s for s in inside] + [right]
            orders += [degree] * (len(inside) + 1)
        fractions.append(tuple(edges))
        degrees.append(tuple(orders))
    return dataclasses.replace(mesh, fractions=tuple(fractions), degrees=tuple(degrees))


def certified(mesh: Mesh, hamiltonian: Sequence[Array], tolerance: float) -> Mesh:
    """Halve the elements over which the Hamiltonian changes: an optimal control switches in there.

    Args:
        mesh: to refine.
        hamiltonian: at both ends of every element, (M, 2) per phase.
        tolerance: of its change over an element, relative to 1 + its median's magnitude.
    """
    fractions, degrees = [], []
    for edges, orders, values in zip(mesh.fractions, mesh.degrees, hamiltonian, strict=True):
        drift = np.abs(values[:, 1] - values[:, 0]) / (1.0 + abs(np.median(values)))
        split = (drift > tolerance) & _longer(np.diff(edges), SHORTEST_CERTIFIED)
        middles = 0.5 * (np.array(edges[1:]) + np.array(edges[:-1]))
        fractions.append(tuple(sorted([*edges, *middles[split].tolist()])))
        degrees.append(tuple(np.repeat(orders, 1 + split).tolist()))
    return dataclasses.replace(mesh, fractions=tuple(fractions), degrees=tuple(degrees))


def _longer(width: Any, than: float) -> Any:
    return width > (1 + CLEARLY) * than


def _misses(quality: Quality, limits: Array, tolerances: Tolerances) -> Array:
    """The largest of all errors of every element, relative to its tolerance, shape (M,)."""
    cost = np.maximum(quality.cost_error, quality.cost_gap) / tolerances.cost
    return np.max([quality.state_error / tolerances.states, cost, limits], axis=0)


def _limits(phase: Phase, quality: Quality, tolerance: float) -> Array:
    """Violations of limits, relative to what asks for a finer mesh, shape (M,)."""
    asked: Any = COARSE
    if phase.path is not None:  # an equation has no room for margins
        asked = np.where(phase.path.lower == phase.path.upper, tolerance, COARSE)
    path = (quality.path_violation / asked).max(axis=1)
    return np.asarray(np.maximum(quality.limit_violation / tolerance, path))
