"""Legendre-Gauss-Radau collocation of a `Problem`, solved by IPOPT.

On every element of the mesh the state is a polynomial of degree d that meets the differential
equation at the d flipped Radau points, the last of which is the element's end: as an integrator
this is Radau IIA, of order 2d - 1 at the edges (Hairer and Wanner, Solving ODEs II, IV.5). The
control is a Bezier polynomial of lower degree on an element and may jump at its edges, hence

- bounds on its coefficients hold for the control everywhere (it lies in their convex hull),
- the state is smooth within elements whatever the control does, and converges at full order,
- slacks and path constraints, imposed at the Radau points and on both sides of every edge, are
  more than the control's freedoms and leave it no room to cheat in between.

max(power, floor) is not smooth; its integral is that of slacks p >= power, p >= floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from trajopt.interpolant import PhaseTrajectory
from trajopt.polynomials import (
    bernstein_matrix,
    control_nodes,
    differentiation_matrix,
    quadrature_weights,
    radau_nodes,
)
from trajopt.problem import Array, Phase, Problem
from trajopt.transcription import Mesh, Result

IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-8,
    "constr_viol_tol": 1e-10,
    "compl_inf_tol": 1e-8,
    "acceptable_iter": 0,
    "max_iter": 500,
    "mu_strategy": "monotone",
    "bound_relax_factor": 0.0,
    "honor_original_bounds": "yes",
}


#: How IPOPT ends after Ctrl-C, which CasADi catches and reports in no other way.
INTERRUPTED = ("NonIpopt_Exception_Thrown", "User_Requested_Stop")


class Transcription:
    """`problem` on `mesh` as a nonlinear program, built once and solved from many guesses.

    The duration, floors, offsets of linkages and all bounds are data of `solve`, so that one
    transcription serves all speeds, windings and both objectives of a gait.
    """

    def __init__(self, problem: Problem, mesh: Mesh) -> None:
        self.problem = problem
        self.mesh = mesh
        self._variables: list[ca.MX] = []
        self._constraints: list[tuple[ca.MX, Array, Array, int | None, tuple[str, ...]]] = []
        self._build()

    # -- building -----------------------------------------------------------------------------

    def _build(self) -> None:
        problem, degree = self.problem, self.mesh.degree
        duration = ca.MX.sym("duration")
        offsets = [ca.MX.sym("offset", len(link.offset)) for link in problem.linkages]
        starts, ends, durations = [], [], []
        cost: Any = 0
        for index, phase in enumerate(problem.phases):
            fractions = self.mesh.fractions[index]
            n, nx = len(fractions) - 1, phase.n_states
            T, start = ca.MX.sym("T"), ca.MX.sym("start", nx)
            states = ca.MX.sym("states", nx * degree, n)
            controls = ca.MX.sym("controls", self.mesh.control_degree + 1, n)
            slacks = ca.MX.sym("slacks", degree, n)
            left = ca.horzcat(start, states[-nx:, :-1])
            h = T * ca.DM(np.diff(fractions)).T
            defects, path, slack, share = _element(phase, self.mesh).map(n)(
                left, states, controls, slacks, h
            )
            zeros = np.zeros(nx * degree * n)
            self._constrain(defects, zeros, zeros, "differential equation")
            self._constrain(path, zeros, zeros, *phase.path.names, path_of=index)
            self._constrain(slack, np.zeros(degree * n), np.full(degree * n, np.inf), "slack")
            self._constrain(
                phase.end.function(states[-nx:, -1]),
                phase.end.lower,
                phase.end.upper,
                *phase.end.names,
            )
            cost = cost + ca.sum2(share)
            self._variables += [T, start, ca.vec(states), ca.vec(controls), ca.vec(slacks)]
            starts.append(start)
            ends.append(states[-nx:, -1])
            durations.append(T)
        for link, offset in zip(problem.linkages, offsets, strict=True):
            gap = starts[link.target] - link.map(ends[link.source]) - offset
            zeros = np.zeros(len(link.offset))
            self._constrain(gap, zeros, zeros, "linkage")
        one = np.zeros(1)
        self._constrain(ca.sum1(ca.vertcat(*durations)) - duration, one, one, "duration")
        symbols = [v if v.is_symbolic() else v.dep(0) for v in self._variables]
        flat = ca.MX.sym("w", sum(v.numel() for v in symbols))
        pieces = ca.vertsplit(flat, np.cumsum([0] + [v.numel() for v in symbols]).tolist())
        shaped = [ca.reshape(p, v.shape) for p, v in zip(pieces, symbols, strict=True)]
        parameters = ca.vertcat(duration, *offsets)
        whole = ca.Function(
            "nlp",
            [*symbols, duration, *offsets],
            [cost, ca.vertcat(*(c[0] for c in self._constraints))],
        )
        objective, constraints = whole(*shaped, duration, *offsets)
        self._nlp = {"x": flat, "p": parameters, "f": objective, "g": constraints}

    def _constrain(
        self, value: ca.MX, lower: Array, upper: Array, *names: str, path_of: int | None = None
    ) -> None:
        self._constraints.append((ca.vec(value), lower, upper, path_of, names))

    def _constraint_bounds(self, problem: Problem) -> tuple[Array, Array]:
        lower, upper = [], []
        for value, low, high, phase, _ in self._constraints:
            if phase is not None:
                path = problem.phases[phase].path
                repeated = value.numel() // len(path.lower)
                low, high = np.tile(path.lower, repeated), np.tile(path.upper, repeated)
            lower.append(low)
            upper.append(high)
        return np.concatenate(lower), np.concatenate(upper)

    def _solver(self, **options: Any) -> ca.Function:
        key = tuple(sorted(options.items()))
        if key not in self._solvers:
            settings = {
                "ipopt": IPOPT | options,
                "print_time": False,
                "error_on_fail": False,
            }
            self._solvers[key] = ca.nlpsol("gait", "ipopt", self._nlp, settings)  # type: ignore[arg-type]
        return self._solvers[key]

    @cached_property
    def _solvers(self) -> dict[Any, ca.Function]:
        return {}

    def _variable_bounds(self, problem: Problem) -> tuple[Array, Array]:
        return tuple(  # type: ignore[return-value]
            np.concatenate([self._phase_bounds(i, p, side) for i, p in enumerate(problem.phases)])
            for side in (0, 1)
        )

    def _phase_bounds(self, index: int, phase: Phase, side: int) -> Array:
        n, degree = len(self.mesh.fractions[index]) - 1, self.mesh.degree
        states = np.tile(phase.state_bounds[side], (n * degree, 1))
        states[-1] = phase.end_bounds[side]
        return np.concatenate(
            [
                [phase.duration_bounds[side]],
                phase.start_bounds[side],
                states.ravel(),
                np.full((self.mesh.control_degree + 1) * n, phase.control_bounds[side][0]),
                np.full(n * degree, (phase.floor, np.inf)[side]),
            ]
        )

    # -- solving ------------------------------------------------------------------------------

    def solve(
        self, guess: Sequence[PhaseTrajectory], problem: Problem | None = None, **options: Any
    ) -> Result:
        """A local optimum near `guess`.

        Args:
            guess: one trajectory per phase, on any mesh.
            problem: with other durations, offsets or floors than the one transcribed.
            options: of IPOPT, over `IPOPT`.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed meanwhile.
        """
        problem = problem or self.problem
        lower, upper = self._variable_bounds(problem)
        start = np.clip(self._pack(guess, problem), lower, upper)
        bounds = self._constraint_bounds(problem)
        solver = self._solver(**options)
        parameters = np.concatenate([[problem.duration], *(k.offset for k in problem.linkages)])
        found = solver(x0=start, p=parameters, lbx=lower, ubx=upper, lbg=bounds[0], ubg=bounds[1])
        stats = solver.stats()
        if stats["return_status"] in INTERRUPTED:
            raise KeyboardInterrupt
        violation, worst = self._violation(np.asarray(found["g"]).ravel(), *bounds)
        return Result(
            phases=self._unpack(np.asarray(found["x"]).ravel()),
            cost=float(found["f"]),
            success=bool(stats["success"]),
            status=str(stats["return_status"]),
            iterations=int(stats["iter_count"]),
            violation=violation,
            worst=worst,
        )

    def _violation(self, values: Array, lower: Array, upper: Array) -> tuple[float, str]:
        outside = np.maximum(np.maximum(lower - values, values - upper), 0.0)
        worst = int(np.argmax(np.nan_to_num(outside, nan=np.inf)))
        first = 0
        for value, _, _, _, names in self._constraints:
            if worst < first + value.numel():
                return float(outside[worst]), names[(worst - first) % len(names)]
            first += value.numel()
        raise AssertionError("the constraints are exhausted")

    def _pack(self, guess: Sequence[PhaseTrajectory], problem: Problem) -> Array:
        nodes = radau_nodes(self.mesh.degree)
        parts: list[Any] = []
        for trajectory, phase, fractions in zip(
            guess, problem.phases, self.mesh.fractions, strict=True
        ):
            T = trajectory.duration
            edges = T * np.array(fractions)
            h = np.diff(edges)
            times = edges[:-1, None] + h[:, None] * nodes[None, 1:]
            states = trajectory.state(times.ravel())
            knots = control_nodes(self.mesh.control_degree)
            inside = edges[:-1, None] + h[:, None] * knots
            values = trajectory.control(inside.ravel(), "right")[:, 0].reshape(inside.shape)
            values[:, -1] = trajectory.control(edges[1:], "left")[:, 0]
            basis = bernstein_matrix(self.mesh.control_degree, knots)
            coefficients = np.linalg.solve(basis, values.T).T
            at_nodes = coefficients @ bernstein_matrix(self.mesh.control_degree, nodes[1:]).T
            power = np.asarray(phase.power(states.T, at_nodes.ravel()[None])).ravel()
            slacks = np.maximum(power, phase.floor)
            parts += [[T], trajectory.start, states.ravel(), coefficients.ravel(), slacks]
        packed = np.concatenate(parts)
        first, scale = 0, problem.duration / sum(p.duration for p in guess)
        for trajectory, fractions in zip(guess, self.mesh.fractions, strict=True):
            packed[first] *= scale
            n, nx = len(fractions) - 1, len(trajectory.start)
            first += 1 + nx + n * (self.mesh.degree * (nx + 1) + self.mesh.control_degree + 1)
        return packed

    def _unpack(self, w: Array) -> tuple[PhaseTrajectory, ...]:
        phases, first, d, m = [], 0, self.mesh.degree, self.mesh.control_degree + 1
        knots = control_nodes(m - 1)
        for phase, fractions in zip(self.problem.phases, self.mesh.fractions, strict=True):
            n, nx = len(fractions) - 1, phase.n_states
            sizes = [1, nx, nx * d * n, m * n, d * n]
            cuts = first + np.cumsum([0, *sizes])
            T, start, states, controls, _ = (w[i:j] for i, j in pairwise(cuts))
            inner = states.reshape(n, d, nx)
            left = np.concatenate([start[None], inner[:-1, -1]])[:, None]
            phases.append(
                PhaseTrajectory(
                    edges=T[0] * np.array(fractions),
                    nodes=radau_nodes(d),
                    states=np.concatenate([left, inner], axis=1),
                    control_nodes=knots,
                    controls=(controls.reshape(n, m) @ bernstein_matrix(m - 1, knots).T)[..., None],
                )
            )
            first = int(cuts[-1])
        return tuple(phases)


def _element(phase: Phase, mesh: Mesh) -> ca.Function:
    """One element: (left state, inner states, control, slacks, h) -> what it contributes."""
    degree, m = mesh.degree, mesh.control_degree + 1
    nx, nodes = phase.n_states, radau_nodes(degree)
    left, inner = ca.MX.sym("left", nx), ca.MX.sym("inner", nx * degree)
    control, slacks, h = ca.MX.sym("control", m), ca.MX.sym("slacks", degree), ca.MX.sym("h")
    points = ca.reshape(inner, nx, degree)
    states = ca.horzcat(left, points)
    controls = control.T @ ca.DM(bernstein_matrix(m - 1, nodes).T)
    rates = phase.flow.map(degree)(points, controls[:, 1:])
    defects = states @ ca.DM(differentiation_matrix(degree).T) - h * rates
    path = phase.path.function.map(degree + 1)(states, controls)
    power = phase.power.map(degree)(points, controls[:, 1:])
    share = h * (ca.DM(quadrature_weights(degree)).T @ slacks)
    return ca.Function(
        "element",
        [left, inner, control, slacks, h],
        [ca.vec(defects), ca.vec(path), slacks - power.T, share],
    )
