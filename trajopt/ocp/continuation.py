"""Follow a solution along a parameter, in steps as long as they succeed.

Every step starts from the extrapolation of the last two solutions, with a small first barrier so
that it stays near. A step that ends elsewhere has jumped to another solution, and counts as failed.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from rimless_gym.checks import positive, real, real_array
from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import InfeasibleBoundsError
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Problem
from trajopt.ocp.scaling import Scales
from trajopt.ocp.solve import WARM_BARRIER, solve
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.ocp.transcription import Transcription

#: The shortest step that is tried by default, as a fraction of the whole way.
SHORTEST = 2.0**-8

#: By what a step is multiplied when it succeeds.
GROWTH = 2.0

#: A step that ends short of a value by less than this fraction of the way is extended to it.
SHORT_OF = 1e-6

#: A step whose solution is farther than this (`distance`) from its extrapolation has jumped to
#: another solution.
MOST_JUMP = 0.3

#: A mesh that has grown to more than so many times the elements of the first one is given up for
#: the first one: refinements where a control used to switch are of no use.
MOST_GROWTH = 2.0


def continued(
    problem_at: Callable[[float], Problem],
    start: Extremal | Sequence[PhaseTrajectory],
    values: Sequence[float],
    *,
    mesh: Mesh | None = None,
    step: float | None = None,
    shortest: float | None = None,
    **settings: Any,
) -> Curve:
    """Follow a solution along a parameter of its problem.

    A step that fails is halved, and one that succeeds lets the next be twice as long.

    Args:
        problem_at: value -> problem. Problems that differ in numbers alone, as those that
            `dataclasses.replace` makes from one problem, share a transcription.
        start: a solution at or near ``values[0]``, or a trajectory near one.
        values: of the parameter, at least two: the first is solved first, from `start`; the others
            are met exactly; the last is the goal.
        mesh: to begin with; that of `start` by default, if it has one.
        step: the longest; by default as far as the next value.
        shortest: the shortest that is tried; by default 1/256 of the whole way.
        settings: of `solve`, options of IPOPT included. With ``passes=0`` every solution is on the
            mesh given; refine the last one with `solve`.

    Returns:
        The curve, which ends early where no shorter step succeeds: see `Curve.obstacle`.

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed.
        TypeError: an argument is of the wrong type.
        ValueError: there are fewer than two values, a number is out of its range, or IPOPT has no
            such option.
    """
    values = [real("values", value) for value in real_array("values", values).ravel().tolist()]
    if len(values) < 2 or any(a == b for a, b in pairwise(values)):
        raise ValueError(f"values = {values}: give a start and a goal, or more, all different")
    if step is not None:
        step = positive("step", step)
    length = sum(abs(b - a) for a, b in pairwise(values))
    shortest = SHORTEST * length if shortest is None else positive("shortest", shortest)
    follower = _Follower(problem_at, start, mesh, settings)
    obstacle = follower.follow(values, step or math.inf, shortest)
    solved, solutions = zip(*follower.solved, strict=True) if follower.solved else ((), ())
    return Curve(solved, solutions, obstacle)


def distance(
    one: Sequence[PhaseTrajectory], other: Sequence[PhaseTrajectory], scales: Scales
) -> float:
    """Largest difference of states at equal fractions of a phase, relative to scale + magnitude."""
    fractions, largest = np.linspace(0.0, 1.0, 33), 0.0
    for a, b, units in zip(one, other, scales.phases, strict=True):
        x, y = (phase.state(phase.duration * fractions) for phase in (a, b))
        scale = units.states + np.maximum(np.abs(x), np.abs(y)).max(axis=0)
        largest = max(largest, float((np.abs(x - y) / scale).max()))
    return largest


def extrapolated(
    before: Sequence[PhaseTrajectory], after: Sequence[PhaseTrajectory], factor: float
) -> tuple[PhaseTrajectory, ...]:
    """`after` plus `factor` times its difference from `before`, on the mesh of `after`."""

    def moved(old: PhaseTrajectory, new: PhaseTrajectory) -> PhaseTrajectory:
        ratio = old.duration / new.duration

        inside = new.edges[:-1, None] + new.element_durations[:, None] * new.nodes
        knots = new.edges[:-1, None] + new.element_durations[:, None] * new.control_nodes
        states = old.state(ratio * inside.ravel()).reshape(new.states.shape)
        controls = old.control(ratio * knots.ravel()).reshape(new.controls.shape)
        controls[:, -1] = old.control(ratio * knots[:, -1], "left")
        return PhaseTrajectory(
            new.edges * max(1.0 + factor * (1.0 - ratio), 0.5),
            new.nodes,
            new.states + factor * (new.states - states),
            new.control_nodes,
            new.controls + factor * (new.controls - controls),
        )

    return tuple(moved(old, new) for old, new in zip(before, after, strict=True))


class _Follower:
    """Goes from solution to solution."""

    def __init__(
        self,
        problem_at: Callable[[float], Problem],
        start: Extremal | Sequence[PhaseTrajectory],
        mesh: Mesh | None,
        settings: dict[str, Any],
    ) -> None:
        self.problem_at, self.settings = problem_at, settings
        self.solved: list[tuple[float, Extremal]] = []
        self.transcription: Transcription | None = None
        self.phases: Sequence[PhaseTrajectory]
        self.parameters: Array | None = None
        self.first_mesh = self.mesh = mesh
        self.options: dict[str, Any] = {}
        if isinstance(start, Extremal):
            self.phases, self.parameters = start.phases, start.parameters
            self.first_mesh = self.mesh = mesh or start.mesh
            self.options = {"mu_init": WARM_BARRIER}
        else:
            self.phases = start

    def follow(self, values: Sequence[float], longest: float, shortest: float) -> Obstacle | None:
        """Go from the first of the values to the last; what is in the way, if anything."""
        step, obstacle = longest, self._solve(values[0])
        for target in values[1:]:
            while obstacle is None and (reached := self.solved[-1][0]) != target:
                way = target - reached
                arrives = step > (1 - SHORT_OF) * abs(way)
                step = min(step, abs(way))
                value = target if arrives else reached + math.copysign(step, way)
                obstacle = self._solve(value)
                if obstacle is None:
                    step = min(GROWTH * step, longest)
                elif step / 2 > (1 - SHORT_OF) * shortest:
                    step, obstacle = step / 2, None
        return obstacle

    def _solve(self, value: float) -> Obstacle | None:
        """Go on to the solution at a value; None if that succeeds, otherwise nothing changes."""
        try:
            problem = self.problem_at(value)
        except InfeasibleBoundsError as error:
            return Obstacle(value, str(error), None)
        guess = self.phases
        if len(self.solved) > 1:
            (first, before), (second, after) = self.solved[-2:]
            factor = (value - second) / (second - first)
            guess = extrapolated(before.phases, after.phases, factor)
        extremal = solve(
            problem,
            guess,
            parameters=self.parameters,
            transcription=self._transcription(problem),
            **{**self.options, **self.settings},
        )
        if not extremal.succeeded or extremal.violations:
            return Obstacle(value, "; ".join(extremal.failures), extremal)
        jump = distance(guess, extremal.phases, extremal.scales) if self.solved else 0.0
        if jump > MOST_JUMP:
            return Obstacle(value, f"a jump to another solution, by {jump:.2g}", extremal)
        self.solved.append((value, extremal))
        self.phases, self.parameters = extremal.phases, extremal.parameters
        self.first_mesh = self.first_mesh or extremal.mesh
        grown = extremal.mesh.elements > MOST_GROWTH * self.first_mesh.elements
        self.mesh = self.first_mesh if grown else extremal.mesh
        self.options = {"mu_init": WARM_BARRIER, "option_sets": ({},)}
        return None

    def _transcription(self, problem: Problem) -> Transcription:
        """A transcription of the problem on the mesh; the last one if it serves."""
        mesh, last = self.mesh or Mesh.uniform(problem), self.transcription
        if last and last.mesh == mesh and last.problem.functions == problem.functions:
            return last
        self.transcription = Transcription(problem, mesh)
        return self.transcription


@dataclasses.dataclass(frozen=True)
class Obstacle:
    """Why a curve ends before its goal."""

    value: float  # of the parameter: the nearest to the curve that failed
    reason: str  # in words
    # the solution that failed; None where the problem's own bounds contradict each other
    attempt: Extremal | None


@dataclasses.dataclass(frozen=True)
class Curve:
    """Solutions along a parameter.

    Attributes:
        values: of the parameter, in order; among them are all values asked for that were reached.
        solutions: one for each value. IPOPT succeeded for all of them; only
            `Extremal.converged` shows whether the mesh is fine enough.
        obstacle: why the goal was not reached; None if it was.
    """

    values: tuple[float, ...] = ()
    solutions: tuple[Extremal, ...] = ()
    obstacle: Obstacle | None = None

    @property
    def reached(self) -> bool:
        """Whether the goal was reached."""
        return self.obstacle is None
