"""Pictures of a solution, drawn without a display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trajopt.ocp.accuracy import Certificate
from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import pair
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.resimulation import simulate_elements
from trajopt.ocp.trajectory import PhaseTrajectory

#: Tolerances of the forward simulation: enough for a picture.
RTOL, ATOL = 1e-7, 1e-9

#: Points of a curve per element.
SAMPLES = 24

HAMILTONIAN = "Hamiltonian"


def plot(
    problem: Problem,
    trajectories: Sequence[PhaseTrajectory],
    p: Array,
    title: str,
    certificate: Certificate | None = None,
) -> Figure:
    """States, controls and, if given, the Hamiltonian against time, phases one after the other.

    Faint lines mark the elements' edges, darker ones the ends of phases; bounds are dashed.
    Simulated states are dotted: where they part from the solution, it is wrong.

    Args:
        problem: whose solution it is.
        trajectories: one per phase.
        p: static parameters.
        title: of the figure.
        certificate: with the Hamiltonian.
    """
    phases = problem.phases
    names = list(dict.fromkeys(name for phase in phases for name in phase.states))
    names += dict.fromkeys(name for phase in phases for name in phase.controls)
    names += [] if certificate is None else [HAMILTONIAN]
    rows = -(-len(names) // 2)
    figure = Figure(figsize=(10.0, 2.1 * rows + 0.6), layout="constrained")
    panels = figure.subplots(rows, 2, sharex=True, squeeze=False).T.ravel()
    named = dict(zip(names, panels, strict=False))
    begins = np.cumsum([0.0, *(trajectory.duration for trajectory in trajectories)])
    for name, panel in named.items():
        panel.set_ylabel(name)
        for trajectory, begin in zip(trajectories, begins, strict=False):
            _mark(panel, begin, trajectory)
    for panel in panels[len(named) :]:
        panel.set_axis_off()
    for phase, trajectory, begin in zip(phases, trajectories, begins, strict=False):
        _draw_phase(named, phase, trajectory, begin, p)
    if certificate is not None:
        _draw_hamiltonian(named[HAMILTONIAN], certificate, trajectories, begins)
    for panel in (panels[rows - 1], named[names[-1]]):
        panel.set_xlabel("time / s")
        panel.tick_params(labelbottom=True)
    figure.suptitle(title, fontsize="medium")
    return figure


def _mark(panel: Axes, begin: float, trajectory: PhaseTrajectory) -> None:
    """Mark the edges of a phase and of its elements."""
    for edge in trajectory.edges[1:-1]:
        panel.axvline(begin + edge, color="0.92", linewidth=0.6, zorder=0)
    for edge in trajectory.edges[[0, -1]]:
        panel.axvline(begin + edge, color="0.6", linewidth=0.8, zorder=0)


def _draw_phase(
    panels: Mapping[str, Axes], phase: Phase, trajectory: PhaseTrajectory, begin: float, p: Array
) -> None:
    """Draw a phase's states and controls in their panels, with their bounds."""
    times, states, controls = _sampled(trajectory)
    simulated_times, simulated = _simulated(phase, trajectory, p)
    for i, name in enumerate(phase.states):
        panels[name].plot(begin + times, states[:, i], color="C0")
        panels[name].plot(begin + simulated_times, simulated[:, i], "k:", linewidth=1.5)
    for i, name in enumerate(phase.controls):
        panels[name].plot(begin + times, controls[:, i], color="C1")
    for name, bounds in phase.bounds.items():
        for bound in filter(np.isfinite, pair(bounds)):
            ends = begin, begin + trajectory.duration
            panels[name].plot(ends, (bound, bound), "--", color="C3", linewidth=0.9)


def _draw_hamiltonian(
    panel: Axes,
    certificate: Certificate,
    trajectories: Sequence[PhaseTrajectory],
    begins: Sequence[float] | Array,
) -> None:
    """Draw the Hamiltonian on both sides of every edge, on a scale that hides rounding."""
    values = certificate.hamiltonian
    for trajectory, begin, sides in zip(trajectories, begins, values, strict=False):
        times = np.stack([trajectory.edges[:-1], trajectory.edges[1:]], axis=1)
        panel.plot(begin + times.ravel(), sides.ravel(), color="C2", marker=".")
    panel.set_title(f"spread {certificate.hamiltonian_spread:.1e}", fontsize="small")
    every = np.concatenate([sides.ravel() for sides in values])
    if np.isfinite(every).all():
        margin = max(0.1 * np.ptp(every), 0.01 * (1.0 + np.abs(every).max()))
        panel.set_ylim(every.min() - margin, every.max() + margin)


def _sampled(trajectory: PhaseTrajectory) -> tuple[Array, Array, Array]:
    """Times, states and controls, element by element, with both limits at every edge."""
    edges = trajectory.edges
    inside = [np.linspace(a, b, SAMPLES) for a, b in pairwise(edges)]
    times = np.concatenate(inside)
    controls = trajectory.control(times)
    controls[SAMPLES - 1 :: SAMPLES] = trajectory.control(edges[1:], "left")
    return times, trajectory.state(times), controls


def _simulated(phase: Phase, trajectory: PhaseTrajectory, p: Array) -> tuple[Array, Array]:
    """Times and states of a phase simulated from its start, NaN where that fails."""
    pieces = list(simulate_elements(phase, trajectory, trajectory.start, p, RTOL, ATOL))
    times, values = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    return times, np.where(np.isfinite(values), values, np.nan)[:, :-1]
