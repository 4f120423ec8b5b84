"""A problem on a mesh as a nonlinear program, built once and solved by IPOPT from many guesses."""

from __future__ import annotations

import copy
import dataclasses
import io
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

import casadi as ca
import numpy as np

from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import Violation
from trajopt.ocp.equations import Equations, Rows
from trajopt.ocp.layout import pack, unpack
from trajopt.ocp.mesh import Mesh
from trajopt.ocp.problem import Problem
from trajopt.ocp.program import assembled, scaled
from trajopt.ocp.scaling import Scales, scales_of
from trajopt.ocp.trajectory import PhaseTrajectory

#: IPOPT's options where a caller sets no others.
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

#: No multipliers of the parameters, which are scales: their function would take time to build.
QUIET = dict.fromkeys(("print_time", "error_on_fail", "calc_lam_p", "show_eval_warnings"), False)
QUIET |= {"no_nlp_grad": True}

#: IPOPT's status where the cost falls without bound.
DIVERGING = "Diverging_Iterates"

#: IPOPT's status after Ctrl-C, which CasADi catches and reports in no other way.
INTERRUPTED = ("NonIpopt_Exception_Thrown", "User_Requested_Stop")


@dataclasses.dataclass(frozen=True)
class Result:
    """What IPOPT returned."""

    phases: tuple[PhaseTrajectory, ...]  # the trajectory, phase by phase
    parameters: Array  # the static parameters
    cost: float  # the objective of the program
    success: bool  # whether IPOPT succeeded
    status: str  # IPOPT's name for how it ended
    iterations: int  # of IPOPT
    # whether it need not be a minimum: IPOPT never moved, or met negative curvature in its last
    # step
    may_be_saddle: bool
    # the most violated constraint of each kind, worst first, none below 1e-9
    violations: tuple[Violation, ...]
    # of the program: `cost`, `unknowns` and all else are in the problem's units, but IPOPT worked
    # on numbers relative to these
    scales: Scales = dataclasses.field(repr=False)
    largest: float  # magnitude of an unknown, relative to its scale
    unknowns: Array = dataclasses.field(repr=False)  # of the program
    # of its constraints; the Lagrangian is cost + multipliers . constraints
    multipliers: Array = dataclasses.field(repr=False)
    # of the bounds on the unknowns, likewise
    bound_multipliers: Array = dataclasses.field(repr=False)


@contextmanager
def interruptible() -> Iterator[None]:
    """Make Ctrl-C in this context raise KeyboardInterrupt, at the latest at the context's end.

    Without it, CasADi's wrappers lose about one Ctrl-C in ten, or turn it into a SystemError. What
    CasADi itself prints about it on stderr is not shown.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pressed = threading.Event()
    former, stderr = signal.getsignal(signal.SIGINT), sys.stderr

    def press(number: int, frame: FrameType | None) -> None:
        pressed.set()
        sys.stderr = io.StringIO()
        if callable(former):
            former(number, frame)

    signal.signal(signal.SIGINT, press)
    try:
        yield
    except Exception as error:
        if pressed.is_set():
            raise KeyboardInterrupt from error
        raise
    finally:
        signal.signal(signal.SIGINT, former)
        sys.stderr = stderr
    if pressed.is_set() and former is signal.default_int_handler:
        raise KeyboardInterrupt


class Transcription:
    """A problem on a mesh as a nonlinear program.

    All bounds, offsets and floors are data of `solve`: one transcription serves all problems that
    differ in numbers alone.

    `program` is what `equations` describe, with exact derivatives. IPOPT gets it in the scales of
    its guess (`trajopt.ocp.scaling`), so that its tolerances are relative; all else is in the
    problem's units.
    """

    def __init__(self, problem: Problem, mesh: Mesh) -> None:
        if len(mesh.degrees) != len(problem.phases):
            raise ValueError(
                f"the mesh has {len(mesh.degrees)} phases, the problem {len(problem.phases)}: "
                "make it with Mesh.uniform(problem, ...)"
            )
        _require_inequalities(problem, mesh)
        self.problem, self.mesh = problem, mesh
        self.equations = Equations(problem, mesh)
        self.layout = self.equations.layout
        self.program = assembled(self.equations.blocks, self.layout.size, self.equations.count)
        self._scaled = scaled(self.program)
        self._solvers: dict[Any, ca.Function] = {}

    def for_problem(self, problem: Problem) -> Transcription:
        """This transcription for another problem; a ValueError if more than numbers differ."""
        if problem is self.problem:
            return self
        if problem.functions != self.problem.functions:
            raise ValueError("the problem differs from the one transcribed in more than numbers")
        twin = copy.copy(self)
        twin.problem = problem
        return twin

    def solver(self, **options: Any) -> ca.Function:
        """IPOPT on the scaled program, with options over `IPOPT`."""
        key = repr(sorted(options.items()))
        if key not in self._solvers:
            settings: dict[str, Any] = {"ipopt": IPOPT | options, **QUIET}
            settings |= self._scaled.derivatives
            try:
                self._solvers[key] = ca.nlpsol("nlp", "ipopt", self._scaled.symbols, settings)
            except RuntimeError as error:
                raise _options_error(options, str(error).splitlines()[-1]) from None
        return self._solvers[key]

    @interruptible()
    def solve(
        self,
        guess: Sequence[PhaseTrajectory],
        problem: Problem | None = None,
        parameters: Array | None = None,
        **options: Any,
    ) -> Result:
        """A local optimum near `guess`, with options over `IPOPT`; errors as of `trajopt.solve`."""
        problem = self.for_problem(problem or self.problem).problem
        lower, upper = self.layout.bounds(problem)
        start = np.clip(pack(self.layout, problem, guess, parameters), lower, upper)
        if not np.isfinite(start).all():
            raise ValueError("guess: its states, controls and parameters must all be finite")
        least, most = self.equations.bounds(problem)
        solver = self.solver(**options)
        scales = scales_of(problem, guess, parameters)
        of_x, of_g = scales.of_unknowns(self.layout), self.equations.scales(scales)
        solution = solver(
            x0=start / of_x,
            p=np.r_[of_x, of_g, scales.cost],
            lbx=lower / of_x,
            ubx=upper / of_x,
            lbg=least / of_g,
            ubg=most / of_g,
        )
        stats = solver.stats()
        if stats["return_status"] in INTERRUPTED:
            raise KeyboardInterrupt
        if stats["return_status"] == "Invalid_Option":
            raise _options_error(options, "linear_solver and others may need more libraries")
        x = np.asarray(solution["x"]).ravel()
        w = np.clip(of_x * x, lower, upper)
        phases, values = unpack(self.layout, w), of_g * np.asarray(solution["g"]).ravel()
        excess = np.maximum(np.maximum(least - values, values - most), 0.0)
        excess = np.nan_to_num(excess, nan=np.inf)
        return Result(
            phases=phases,
            parameters=self.layout.split(w)[-1, "parameters", 0].ravel(),
            cost=scales.cost * float(solution["f"]),
            success=bool(stats["success"]),
            status=str(stats["return_status"]),
            iterations=int(stats["iter_count"]),
            may_be_saddle=stats["iter_count"] == 0 or _curved_down(stats),
            violations=self.equations.violations(excess, scales, phases, problem),
            scales=scales,
            largest=float(np.abs(x).max()),
            unknowns=w,
            multipliers=np.asarray(solution["lam_g"]).ravel() * scales.cost / of_g,
            bound_multipliers=np.asarray(solution["lam_x"]).ravel() * scales.cost / of_x,
        )

    def multipliers_of(self, result: Result) -> Iterator[tuple[Rows, Array]]:
        """Every kind of constraint, with its multipliers."""
        rows = self.equations.rows
        cuts = np.cumsum([each.count for each in rows])
        yield from zip(rows, np.split(result.multipliers, cuts[:-1]), strict=True)


def _options_error(options: Mapping[str, Any], reason: str) -> ValueError:
    return ValueError(
        f"{options}: IPOPT does not accept these options ({reason}); "
        "https://coin-or.github.io/Ipopt/OPTIONS.html lists them"
    )


def _curved_down(stats: dict[str, Any]) -> bool:
    """Whether IPOPT had to make the Hessian of its last step convex."""
    added = stats.get("iterations", {}).get("regularization_size", [])
    return bool(added) and added[-1] > 0.0


def _require_inequalities(problem: Problem, mesh: Mesh) -> None:
    if mesh.scheme_of_degree(mesh.degrees[0][0]).shared_controls:
        return
    for phase in problem.phases:
        path = phase.path
        if path is not None and np.any(path.lower == path.upper):
            name = path.names[int(np.argmax(path.lower == path.upper))]
            raise ValueError(
                f"path constraint {name!r} of phase {phase.name!r} is an equation: {mesh.scheme} "
                "imposes path constraints at more places than its controls have degrees of "
                "freedom; solve the equation for a control, or use another scheme"
            )
