"""The thesis's figures of a solved case, drawn anew: trajectories, verification, power."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from agents.reports.charts import Axis, Chart, Series
from scripts.studies.thesis.experiments.power import powers
from scripts.studies.thesis.experiments.replay import Replay, sampled_times
from scripts.studies.thesis.experiments.solved import Solved
from trajopt.gaits.problem import STATES
from trajopt.ocp.arrays import Array
from trajopt.ocp.trajectory import PhaseTrajectory

#: Charts of states: what they show, the unit, the columns.
PANELS = (("Angles", "angle / pi", (0, 1)), ("Rates", "rate / (pi/s)", (2, 3)))

TIME = Axis("t / s")
VOLTAGE = Axis("voltage / V")
COLOURS = ("teal", "orange")

#: Lines have at most about so many points, more than a screen shows.
FINEST = 250


def trajectories(solved: Solved) -> list[Chart]:
    """States in units of pi and the voltage against time (Figures 4.1, 4.2, 4.4, 4.7 ...)."""
    times, states, _ = _sampled(solved)
    charts = []
    for title, unit, columns in PANELS:
        lines = [
            Series(STATES[i], times, states[:, i] / math.pi, colour=colour)
            for i, colour in zip(columns, COLOURS, strict=True)
        ]
        charts.append(Chart(title, TIME, Axis(unit), lines))
    cost = f"Voltage; cost = {solved.extremal.cost:.6f}"
    return [*charts, Chart(cost, TIME, VOLTAGE, [_voltage(solved)])]


def verification(solved: Solved) -> list[Chart]:
    """States simulated: solid with the control itself, dashed at 1 kHz as the thesis did."""
    runs: tuple[tuple[Replay, str, str], ...] = (
        (solved.simulated, "solid", ""),
        (solved.resampled, "dashed", ", 1 kHz"),
    )
    errors = (
        f"off by {solved.simulated.state_error:.1e}, at 1 kHz by {solved.resampled.state_error:.1e}"
    )
    charts = []
    for title, unit, columns in PANELS:
        lines = []
        for run, line, suffix in runs:
            times, states = _split_at_events(*_thinned(run.times, run.states))
            for i, colour in zip(columns, COLOURS, strict=True):
                own = colour if line == "solid" else "ink"
                y = states[:, i] / math.pi
                lines.append(Series(STATES[i] + suffix, times, y, colour=own, line=line, width=1.2))
        charts.append(Chart(f"{title}, simulated: {errors}", TIME, Axis(unit), lines))
    return charts


def power(solved: Solved) -> list[Chart]:
    """Powers at the motor's output, and the integral of the total (Figures 4.3, 4.6 ...)."""
    lines: dict[str, list[tuple[Array, Array]]] = {"passive": [], "torque": [], "total": []}
    for begin, phase in _in_time(solved.motion):
        drawn = powers(solved.machine, phase)
        for name, parts in lines.items():
            times, values = _thinned(begin + drawn.times, getattr(drawn, name))
            parts.append((times, values))
    styles = (("teal", "solid"), ("orange", "solid"), ("ink", "dashed"))
    series = [
        Series(name, *_end_to_end(parts), colour=colour, line=line, width=1.2)
        for (name, parts), (colour, line) in zip(lines.items(), styles, strict=True)
    ]
    title = f"Power; energy integral = {solved.energy:.6f} J"
    return [Chart(title, TIME, Axis("power / W"), series)]


def _voltage(solved: Solved) -> Series:
    times, _, volts = _sampled(solved)
    return Series("voltage", times, volts, colour="blue")


def _sampled(solved: Solved) -> tuple[Array, Array, Array]:
    """Times, states and voltages of the motion, with NaN between its steps."""
    times, states, volts = list[Array](), list[Array](), list[Array]()
    for begin, phase in _in_time(solved.motion):
        (t,) = _thinned(sampled_times(phase))
        times.append(np.append(begin + t, np.nan))
        states.append(np.vstack([phase.state(t), np.full(len(STATES), np.nan)]))
        volts.append(np.append(phase.control(t)[:, 0], np.nan))
    return np.concatenate(times), np.concatenate(states), np.concatenate(volts)


def _in_time(phases: tuple[PhaseTrajectory, ...]) -> Iterator[tuple[float, PhaseTrajectory]]:
    begin = 0.0
    for phase in phases:
        yield begin, phase
        begin += phase.duration


def _end_to_end(parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Lines as one that is interrupted between them."""
    x = [np.append(times, np.nan) for times, _ in parts]
    y = [np.append(values, np.nan) for _, values in parts]
    return np.concatenate(x), np.concatenate(y)


def _thinned(times: Array, *values: Array) -> tuple[Array, ...]:
    """Every so many of the points, with the last one and both sides of every jump."""
    every = max(1, len(times) // FINEST)
    jumps = np.flatnonzero(np.diff(times) == 0.0)
    kept = np.union1d(np.arange(0, len(times), every), [*jumps, *(jumps + 1), len(times) - 1])
    kept = kept.astype(int)
    return tuple(each[kept] for each in (times, *values))


def _split_at_events(times: Array, states: Array) -> tuple[Array, Array]:
    """Times and states with a NaN wherever the state jumps, so that no line is drawn there."""
    jumps = np.flatnonzero(np.diff(times) == 0.0) + 1
    return np.insert(times, jumps, np.nan), np.insert(states, jumps, np.nan, axis=0)
