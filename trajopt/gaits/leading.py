"""A known gait led to another speed, machine or objective in small steps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rimless_gym.params import WheelParams
from trajopt.gaits.gait_problem import gait_problem
from trajopt.gaits.solution import Solution
from trajopt.gaits.stance import CONTROL_DEGREE
from trajopt.ocp.continuation import Curve, continued
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Problem
from trajopt.ocp.solve import solve
from trajopt.ocp.trajectory import PhaseTrajectory

#: Longest step of continuation in speed (m/s), and by what fraction a single one may be longer:
#: the speeds of gaits a whole number of steps apart are exact only to a solver's tolerance.
SPEED_STEP, STRETCH = 0.025, 1e-6

#: Shortest step (m/s). Shorter ones come a little nearer to where a family of gaits ends, and take
#: several times as long to find out that it does.
SHORTEST_STEP = SPEED_STEP / 2

#: A gait of the same machine whose speed differs by less (m/s) is followed with a smaller barrier.
#: (Not a round number, because differences of speeds are.)
SAME_SPEED = 9e-4

#: Elements per step and degree of a mesh that takes the place of a clock's intervals.
FREE_ELEMENTS, FREE_DEGREE = 16, 7

#: IPOPT's first barrier on the way and for the same gait again, and its iterations on the way.
BARRIER, SAME_BARRIER, ITERATIONS = 1e-3, 1e-5, 150


def led(
    params: WheelParams, lead: Solution, speed: float, regeneration: bool
) -> tuple[Extremal | None, str]:
    """`lead` carried over to a machine, speed and objective; or None, and what is in the way."""

    def problem(at: float) -> Problem:
        turns = lead.theta_turns
        return gait_problem(
            params, speed=at, steps=lead.steps, theta_turns=turns, regeneration=regeneration
        )

    mesh = own_mesh(lead.phases) if lead.hold is None else _free_mesh(problem(lead.speed))
    phases: Sequence[PhaseTrajectory] = lead.phases
    reached = lead.speed
    if abs(speed - lead.speed) > (1 + STRETCH) * SPEED_STEP:
        curve = _followed(problem, lead, speed, mesh)
        if not curve.reached:
            return None, _stopped(curve, lead.speed)
        phases, reached = curve.solutions[-1].phases, speed
    same = lead.params == params and abs(speed - lead.speed) < SAME_SPEED
    found = solve(
        problem(speed), phases, mesh, verify=False, mu_init=SAME_BARRIER if same else BARRIER
    )
    if not found.succeeded:
        return None, _obstacle(found, reached)
    return found, ""


def own_mesh(phases: Sequence[PhaseTrajectory]) -> Mesh:
    """The mesh on which `phases` are given."""
    fractions = tuple(tuple(float(s) for s in p.edges / p.duration) for p in phases)
    degrees = tuple((len(p.nodes) - 1,) * (len(p.edges) - 1) for p in phases)
    return Mesh(fractions, degrees, control_degree=CONTROL_DEGREE)


def _free_mesh(problem: Problem) -> Mesh:
    """A mesh for a gait led from one whose voltage is held: its own has an element per interval."""
    return Mesh.uniform(problem, FREE_ELEMENTS, FREE_DEGREE, control_degree=CONTROL_DEGREE)


def _followed(problem: Any, lead: Solution, speed: float, mesh: Mesh) -> Curve:
    return continued(
        problem,
        lead.phases,
        [lead.speed, speed],
        mesh=mesh,
        step=SPEED_STEP,
        shortest=SHORTEST_STEP,
        passes=0,
        verify=False,
        option_sets=({},),
        mu_init=BARRIER,
        max_iter=ITERATIONS,
    )


def _stopped(curve: Curve, begin: float) -> str:
    """Why a curve did not reach its goal."""
    reached = curve.values[-1] if curve.values else begin
    assert curve.obstacle is not None  # Ctrl-C raises
    attempt = curve.obstacle.attempt
    if attempt is None or attempt.succeeded:
        return f"{curve.obstacle.reason}; {reached:.3f} m/s was reached"
    return _obstacle(attempt, reached)


def _obstacle(found: Extremal, reached: float) -> str:
    worst = found.violations[0] if found.violations else "no constraint violated"
    return f"{found.status}, {worst}; {reached:.3f} m/s was reached"
