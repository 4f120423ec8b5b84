"""dymos on the cart-pole: its own example's equations, Gauss-Lobatto of order 3, SciPy's SLSQP.

With IPOPT or SNOPT from pyOptSparse dymos would be faster, but pip cannot install pyOptSparse
without compiling it. Linear algebra runs on one thread, because SLSQP on small dense matrices is
several times as slow on two.
"""

from __future__ import annotations

import os
import tempfile
import time
from importlib.metadata import version
from typing import Any

os.environ |= {"OPENMDAO_REPORTS": "0", "OPENBLAS_NUM_THREADS": "1"}

import dymos as dm  # type: ignore[import-not-found]
import numpy as np
import openmdao.api as om  # type: ignore[import-not-found]
from dymos.examples.cart_pole.cartpole_dynamics import (  # type: ignore[import-not-found]
    CartPoleDynamics,
)

from .. import cartpole
from ..protocol import Measure, serve

#: Names of the states (in the order of `cartpole.START`) and of their rates, and units.
STATES = (
    ("x", "x_dot", "m"),
    ("theta", "theta_dot", "rad"),
    ("x_dot", "x_dotdot", "m/s"),
    ("theta_dot", "theta_dotdot", "rad/s"),
)


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Each repetition builds the problem and solves it once, in a folder for dymos's files."""

    def measure(seconds: float) -> dict[str, Any]:
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                return cartpole.repeated(once, seconds)
            finally:
                os.chdir("/")

    about = {
        "version": f"dymos {version('dymos')}",
        "optimiser_version": f"scipy {version('scipy')}",
    }
    return measure, about


def once() -> dict[str, float]:
    """Build, which includes the colouring of the derivatives, and solve."""
    begin = time.perf_counter()
    problem = build()
    built = time.perf_counter()
    result = problem.run_driver()
    energy = problem.get_val("trajectory.phase.states:energy")
    return {
        "build": built - begin,
        "solve": time.perf_counter() - built,
        "iterations": result.deriv_evals,
        "cost": float(energy[-1, 0]) if result.success else np.nan,
    }


def build() -> Any:
    """The problem, ready to be solved."""
    problem = om.Problem(reports=False)
    trajectory = problem.model.add_subsystem("trajectory", dm.Trajectory())
    lobatto = dm.GaussLobatto(num_segments=cartpole.SEGMENTS, order=3)
    phase = trajectory.add_phase(
        "phase", dm.Phase(ode_class=CartPoleDynamics, transcription=lobatto)
    )
    phase.set_time_options(fix_initial=True, fix_duration=True, duration_val=cartpole.DURATION)
    ends = {"fix_initial": True, "fix_final": True, "shape": (1,)}
    for name, rate, units in STATES:
        track = {"lower": -cartpole.TRACK, "upper": cartpole.TRACK} if name == "x" else {}
        phase.add_state(name, rate_source=rate, units=units, **ends, **track)
    phase.add_state("energy", rate_source="e_dot", units="N**2*s", fix_initial=True, shape=(1,))
    force = {"lower": -cartpole.FORCE, "upper": cartpole.FORCE}
    phase.add_control("f", shape=(1,), units="N", rate_continuity=False, **force)
    for name, value, units in (
        ("m_cart", cartpole.CART, "kg"),
        ("m_pole", cartpole.POLE, "kg"),
        ("l_pole", cartpole.LENGTH, "m"),
    ):
        phase.add_parameter(name, val=value, units=units, static_target=True)
    phase.add_objective("energy", loc="final")
    problem.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", maxiter=1000, disp=False)
    problem.driver.declare_coloring(show_summary=False)
    problem.setup(check=False)
    phase.set_time_val(initial=0.0)
    for (name, _, _), first, last in zip(STATES, cartpole.line(0), cartpole.line(1), strict=True):
        phase.set_state_val(name, [first, last])
    phase.set_state_val("energy", [0.0, 0.0])
    phase.set_control_val("f", [0.0, 0.0])
    problem.run_model()
    problem.driver._get_coloring()
    return problem


if __name__ == "__main__":
    serve(setup)
