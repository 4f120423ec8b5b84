"""One case solved from many starts, refined and simulated."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rimless_gym.equations import equations
from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from scripts.studies.thesis.cases import Case, Key, case_of
from trajopt.gaits.verify import simulated_stride
from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import pair
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.guesses import Guess, Waypoints
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.multi_start import Outcome, multi_start
from trajopt.ocp.solve import WARM_BARRIER, solve
from trajopt.ocp.trajectory import PhaseTrajectory

#: Costs that differ by less (relative, absolute) count as equal.
AS_GOOD = (1e-4, 1e-7)


def solved(case: Case, before: SolvedCase | None = None) -> SolvedCase:
    """Solve a case, after `before`, the solution of `case.after`, and simulate what came out."""
    problem = case.problem(before.extremal if before else None)
    search = multi_start(
        problem,
        WaypointStarts(problem, durations=case.effort.durations),
        case.effort.starts,
        mesh=Mesh.uniform(problem, case.effort.elements),
        same=same,
    )
    if not search.optima:
        raise RuntimeError(f"experiment {case.experiment}, {case.variant}: {search.report()}")
    best = search.optima[0].best
    extremal = solve(
        problem,
        best.phases,
        search.mesh,
        parameters=best.parameters,
        tolerance=case.effort.tolerance,
        mu_init=WARM_BARRIER,
    )
    motion = extremal.phases
    if before and case.appended:
        motion = before.motion + motion
    return SolvedCase(
        key=case.key,
        extremal=extremal,
        optima=tuple(
            (o.cost, len(o.starts), sum(phase.duration for phase in o.phases))
            for o in search.optima
        ),
        failed=len(search.failures),
        reaching=len(search.optima[0].starts),
        motion=motion,
        simulated=replayed(case.machine(extremal.parameters), motion),
    )


def same(one: Outcome, other: Outcome) -> bool:
    """Whether two outcomes cost the same; then they count as one optimum."""
    relative, absolute = AS_GOOD
    return math.isclose(one.cost, other.cost, rel_tol=relative, abs_tol=absolute)


#: The largest errors of a converged case: of the mesh, the simulated states, the touchdowns (s).
MESH_ERROR, STATE_ERROR, TIME_ERROR = 1e-7, 1e-6, 1e-8


@dataclasses.dataclass(frozen=True)
class SolvedCase:
    """A case and its solution."""

    key: Key  # of the case
    extremal: Extremal  # the best solution, refined
    motion: tuple[PhaseTrajectory, ...]  # its steps, after those that it continues
    # cost, number of starts and duration (s) of each local optimum, best first
    optima: tuple[tuple[float, int, float], ...]
    failed: int  # number of starts that failed
    reaching: int  # number of starts that reached the best optimum
    simulated: Replay  # the motion under its own control

    @property
    def case(self) -> Case:
        """The case."""
        return case_of(self.key)

    @property
    def machine(self) -> WheelParams:
        """The machine, with the values found for what was to be chosen."""
        return self.case.machine(self.extremal.parameters)

    @property
    def energy(self) -> float:
        """Integral of the motor's power without sign over all steps (J), as the thesis has it."""
        return energy(self.machine, self.motion)

    @property
    def converged(self) -> bool:
        """Whether the solver converged and the simulation confirms it."""
        if not (self.extremal.converged and self.extremal.mesh_error <= MESH_ERROR):
            return False
        late = max(self.simulated.touchdown_time_errors, default=0.0)
        near = self.simulated.state_error <= STATE_ERROR and late <= TIME_ERROR
        return self.case.limit or near

    def rows(self) -> list[dict[str, Any]]:
        """Rows of `results.json`: one for every time that the thesis prints the case."""
        return [
            {
                "experiment": self.case.experiment,
                "variant": printed.variant,
                "thesis_cost": printed.cost,
                "cost": self.extremal.cost,
                "thesis_energy_J": printed.energy,
                "energy_J": self.energy,
                **self._figures(),
            }
            for printed in self.case.printed
        ]

    def _figures(self) -> dict[str, Any]:
        extremal, exact = self.extremal, self.simulated
        names = extremal.problem.parameters
        peak = max(np.abs(p.control(sampled_times(p))).max() for p in self.motion)
        return {
            "final_time": extremal.duration,
            "max_state_error": exact.state_error,
            "touchdown_time_error": _number(max(exact.touchdown_time_errors, default=math.inf)),
            "min_normal_force_over_weight": least_normal_force(self.machine, self.motion),
            "peak_voltage": float(peak),
            "converged": self.converged,
            "starts": self.case.effort.starts,
            "starts_reaching_best": self.reaching,
            "starts_failed": self.failed,
            "local_optima": [list(optimum) for optimum in self.optima],
            "parameters": dict(zip(names, extremal.parameters.tolist(), strict=True)),
            "mesh_error": extremal.mesh_error,
        }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


#: Times per element of a mesh at which motions are compared.
SAMPLES = 24

#: Simulated past the planned end (s) until the last touchdown has happened.
SPARE_TIMES = (1e-8, 1e-7, 1e-6, 1e-5, 1e-3)

#: Below this phi' (rad/s) a step ends without a collision: its leg comes to rest at the guard.
COLLISIONLESS = 1e-6


@dataclasses.dataclass(frozen=True)
class Replay:
    """A motion simulated by the reference simulator, the foot pinned to the ground."""

    times: Array  # of the simulated states (s), shape (N,); an event's time is there twice
    states: Array  # shape (N, 4)
    # largest deviation from the solution's states, all steps simulated in one (rad, rad/s)
    state_error: float
    # one per step that ends in a collision (s); infinite if its touchdown did not happen
    touchdown_time_errors: tuple[float, ...]


def replayed(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> Replay:
    """Simulate under the solution's own control.

    States are compared step by step, at the times that lie within the simulated step too.
    """
    motion = simulated_stride(params, phases, SPARE_TIMES)
    landings = [float(event.time) for event in motion.touchdowns if event.direction > 0]
    times = landings[: len(phases)]
    marks = [0.0, *times, *[float(motion.t[-1])] * (len(phases) - len(times))]
    error, begin, errors = 0.0, 0.0, []
    for i, phase in enumerate(phases):
        local = sampled_times(phase)
        at = np.clip(begin + local, marks[i], marks[i + 1])
        states = motion.state(at)
        states[at >= marks[i + 1]] = motion.state(marks[i + 1], side="left")
        error = max(error, float(np.abs(states - phase.state(local)).max()))
        begin += phase.duration
        if abs(phase.end[2]) >= COLLISIONLESS:
            errors.append(abs(times[i] - begin) if i < len(times) else math.inf)
    return Replay(motion.t, motion.x, error, tuple(errors))


def sampled_times(phase: PhaseTrajectory) -> Array:
    """Times within a phase, evenly spread over every element, ends included (s)."""
    inside = np.linspace(phase.edges[:-1], phase.edges[1:], SAMPLES, endpoint=False)
    return np.append(inside.T.ravel(), phase.duration)


_eq = equations(np.sin, np.cos, sqrt=np.sqrt)  # of arrays


def energy(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> float:
    """The energy that the thesis reports: the integral of |T psi'| (J)."""
    nodes, weights = np.polynomial.legendre.leggauss(SAMPLES)
    total = 0.0
    for phase in phases:
        h = phase.element_durations
        times = phase.edges[:-1, None] + 0.5 * h[:, None] * (1 + nodes)
        rate, volts = _motor(params, phase, times.ravel())
        power = np.abs(_eq.shaft_power(rate, volts, params.constants))
        total += float(0.5 * h @ (power.reshape(times.shape) @ weights))
    return total


def _motor(params: WheelParams, phase: PhaseTrajectory, times: Array) -> tuple[Array, Array]:
    """psi' (rad/s) and the voltage (V) at times of a phase."""
    x = phase.state(times)
    rate = _eq.relative_rate(x[:, 2], x[:, 3], params.constants)
    return rate, phase.control(times)[:, 0]


def least_normal_force(params: WheelParams, phases: Sequence[PhaseTrajectory]) -> float:
    """Smallest normal force on the foot, in weights; negative where its pin joint pulls it down."""
    reaction: Any = HybridModel(params).functions["ground_reaction"]
    least = math.inf
    for phase in phases:
        times = sampled_times(phase)
        forces = np.asarray(reaction(phase.state(times).T, phase.control(times).T))
        least = min(least, float(forces[1].min()) / params.weight)
    return least


@dataclasses.dataclass(frozen=True)
class WaypointStarts(Waypoints):
    """Random waypoints; the logarithms of the durations are uniformly distributed."""

    durations: tuple[float, float] = (0.2, 4.0)  # least and most (s)

    def __call__(self, rng: np.random.Generator, index: int) -> Guess:
        """Guess number `index`."""
        low, high = np.log(self.durations)
        pairs = zip(self.problem.phases, super().__call__(rng, index), strict=True)
        return tuple(
            _stretched(trajectory, np.clip(np.exp(rng.uniform(low, high)), *pair(phase.duration)))
            for phase, trajectory in pairs
        )


def _stretched(trajectory: PhaseTrajectory, duration: float) -> PhaseTrajectory:
    return dataclasses.replace(
        trajectory, edges=trajectory.edges * (duration / trajectory.duration)
    )
