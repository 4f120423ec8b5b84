"""The thesis's figures of a solved case, drawn anew: trajectories, verification, power."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scripts.thesis.experiments.power import powers
from scripts.thesis.experiments.replay import Replay, sampled_times
from scripts.thesis.experiments.solved import Solved
from trajopt.gaits.stance import STATES
from trajopt.ocp.arrays import Array
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

#: Columns of the state by panel: angles, then rates.
PANELS = ((0, 1), (2, 3))

COLORS = ("C0", "C1", "C0", "C1")


def trajectories(solved: Solved) -> Figure:
    """States in units of pi and the voltage against time (Figures 4.1, 4.2, 4.4, 4.7 ...)."""
    figure, panels = _three_panels()
    for begin, phase in _in_time(solved.motion):
        times = sampled_times(phase)
        x = phase.state(times)
        for panel, columns in zip(panels, PANELS, strict=False):
            for i in columns:
                name = STATES[i] if begin == 0.0 else None
                panel.plot(begin + times, x[:, i] / math.pi, color=COLORS[i], label=name)
        _draw_voltage(panels[2], begin + times, phase.control(times)[:, 0])
    return _finished(figure, panels, f"Cost = {solved.extremal.cost:.6f}")


def verification(solved: Solved) -> Figure:
    """The same, simulated: solid with the control itself, dashed at 1 kHz as the thesis did."""
    figure, panels = _three_panels()
    runs: tuple[tuple[Replay, str, str], ...] = (
        (solved.simulated, "-", ""),
        (solved.resampled, "--", ", 1 kHz"),
    )
    for run, style, suffix in runs:
        times, states = _split_at_events(run.times, run.states)
        for panel, columns in zip(panels, PANELS, strict=False):
            for i in columns:
                color = COLORS[i] if style == "-" else "k"
                label = STATES[i] + suffix
                panel.plot(times, states[:, i] / math.pi, style, color=color, lw=1.2, label=label)
    for begin, phase in _in_time(solved.motion):
        times = sampled_times(phase)
        _draw_voltage(panels[2], begin + times, phase.control(times)[:, 0])
    errors = (
        f"states off by {solved.simulated.state_error:.1e}, "
        f"at 1 kHz by {solved.resampled.state_error:.1e}"
    )
    return _finished(figure, panels, errors)


def power(solved: Solved) -> Figure:
    """Powers at the motor's output, and the integral of the total (Figures 4.3, 4.6 ...)."""
    figure = Figure(figsize=(7.0, 2.8), layout="constrained")
    panel = figure.subplots()
    for begin, phase in _in_time(solved.motion):
        drawn = powers(solved.machine, phase)
        lines = (("passive", "C0-"), ("torque", "C1-"), ("total", "k--"))
        for name, style in lines:
            label = name if begin == 0.0 else None
            panel.plot(begin + drawn.times, getattr(drawn, name), style, lw=1.2, label=label)
    panel.set(xlabel="t / s", ylabel="power / W", title=f"Energy integral = {solved.energy:.6f} J")
    panel.legend(fontsize="small")
    return figure


def _three_panels() -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(7.0, 5.6), layout="constrained")
    panels = list(figure.subplots(3, 1, sharex=True))
    for panel, label in zip(panels, ("angle / pi", "rate / (pi/s)", "voltage / V"), strict=True):
        panel.set_ylabel(label)
    return figure, panels


def _finished(figure: Figure, panels: list[Axes], title: str) -> Figure:
    for panel in panels[:2]:
        panel.legend(fontsize="small", ncols=2)
    panels[2].set_xlabel("t / s")
    panels[0].set_title(title, fontsize="medium")
    return figure


def _draw_voltage(panel: Axes, times: Array, volts: Array) -> None:
    panel.plot(times, volts, color="C2", lw=1.2)


def _in_time(phases: tuple[PhaseTrajectory, ...]) -> Iterator[tuple[float, PhaseTrajectory]]:
    begin = 0.0
    for phase in phases:
        yield begin, phase
        begin += phase.duration


def _split_at_events(times: Array, states: Array) -> tuple[Array, Array]:
    """Times and states with a NaN wherever the state jumps, so that no line is drawn there."""
    jumps = np.flatnonzero(np.diff(times) == 0.0) + 1
    return np.insert(times, jumps, np.nan), np.insert(states, jumps, np.nan, axis=0)
