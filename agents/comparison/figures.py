"""Figures of the comparison: limit cycles, cost of transport over speed, and the animation."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from tqdm import tqdm

from agents.conditions import Conditions
from agents.policies import Policy
from agents.rollout import Rollout
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import FOOT, MODE, PHI, THETA
from rimless_gym.params import WheelParams
from rimless_gym.rendering.wheel import Scene, draw, save_gif
from trajopt.feedback.law import Floats
from trajopt.gaits.fronts import CotFront
from trajopt.gaits.solution import Solution

INK, FAINT = "#26303b", "#8a97a6"
COLOURS = ("#0b8f83", "#e5562e", "#3b6fb6", "#b0892b", "#8459a8")
MARKERS = "P*XDv^<>ph"


@dataclasses.dataclass(frozen=True)
class Walk:
    """One roll-out.

    Attributes:
        states: at the start of each control interval, (N, STATE_SIZE).
        voltages: held over it (V), (N,).
        energies: drawn over it (J), E+, (N,).
        distances: travelled over it (m), (N,).
    """

    states: Floats
    voltages: Floats
    energies: Floats
    distances: Floats

    def until(self, seconds: float) -> Walk:
        """Its beginning."""
        n = round(seconds / CONTROL_PERIOD)
        return Walk(self.states[:n], self.voltages[:n], self.energies[:n], self.distances[:n])


def record(params: WheelParams, policy: Policy, start: Floats, seconds: float) -> Walk:
    """Roll a policy out from one hybrid state (STATE_SIZE,) until it falls or time is up."""
    n_intervals = round(seconds / CONTROL_PERIOD)
    intervals = list(Rollout(Conditions(params), policy, start[None], n_intervals))
    drawn = [i.info["electrical_positive"] + i.info["idle"] for i in intervals]
    return Walk(
        np.concatenate([interval.states for interval in intervals]),
        params.voltage_limit * np.concatenate([interval.actions for interval in intervals]),
        np.concatenate(drawn),
        np.concatenate([interval.info["distance"] for interval in intervals]),
    )


def plot_limit_cycles(
    path: Path, gait: Solution, walks: Mapping[str, Walk], seconds: float = 6.0
) -> None:
    """phi against phi' and theta against theta': the optimal cycle, and learned ones over it."""
    times = np.linspace(0.0, gait.duration, 1500)
    cycles = {"optimal": gait.state(times)}
    for name, walk in walks.items():
        cycles[name] = walk.states[-round(seconds / CONTROL_PERIOD) :, :4]
    with matplotlib.rc_context(_STYLE):
        figure, axes = plt.subplots(1, 2, figsize=(10, 4.4), layout="constrained")
        for (name, states), colour in zip(cycles.items(), COLOURS, strict=False):
            optimal = name == "optimal"
            style = {
                "color": INK if optimal else colour,
                "linewidth": 2.4 if optimal else 0.9,
                "alpha": 1.0 if optimal else 0.75,
                "zorder": 1 if optimal else 2,
            }
            angle = np.mod(states[:, 1] + math.pi, 2 * math.pi) - math.pi
            axes[0].plot(*_broken(states[:, 0], states[:, 2], 0.5), label=name, **style)
            axes[1].plot(*_broken(angle, states[:, 3], math.pi), label=name, **style)
        axes[0].set(xlabel="leg angle phi (rad)", ylabel="phi' (rad/s)", title="wheel")
        axes[1].set(xlabel="pendulum angle theta (rad)", ylabel="theta' (rad/s)", title="pendulum")
        axes[1].set_xticks([-math.pi, 0, math.pi], ["-pi", "0", "pi"])
        axes[0].legend(frameon=False)
        figure.savefig(path, dpi=150)
        plt.close(figure)


def plot_cot_against_speed(
    path: Path, front: CotFront, held: CotFront, points: Mapping[str, tuple[float, float]]
) -> None:
    """Cost of transport over speed: the optimal gaits by steps per stride, and learned policies.

    Args:
        path: of the picture.
        front: of optimal gaits with a continuous voltage.
        held: of gaits whose voltage is held, against which policies are measured.
        points: name -> (speed, CoT); those that are not finite are left out.
    """
    with matplotlib.rc_context(_STYLE):
        figure, axes = plt.subplots(figsize=(7, 4.6), layout="constrained")
        for steps, marker in zip(sorted({s.steps for s in front.solutions}), "os^Dv", strict=False):
            gaits = [s for s in front.solutions if s.steps == steps]
            axes.plot(
                [s.speed for s in gaits],
                [s.cot for s in gaits],
                marker,
                color=FAINT,
                markersize=5,
                markerfacecolor="none",
                label=f"optimal, {steps} step{'s' if steps > 1 else ''} per stride",
            )
        for of, name, style in (
            (front, "optimal, voltage free", "--"),
            (held, f"optimal, voltage held for {1e3 * CONTROL_PERIOD:g} ms", "-"),
        ):
            axes.plot(
                [s.speed for s in of.envelope],
                [s.cot for s in of.envelope],
                style,
                color=INK,
                linewidth=1.5,
                label=name,
            )
        for i, (name, (speed, cot)) in enumerate(points.items()):
            if math.isfinite(speed) and math.isfinite(cot):
                marker, colour = MARKERS[i % len(MARKERS)], COLOURS[i % len(COLOURS)]
                axes.plot(speed, cot, marker, color=colour, markersize=9, alpha=0.8, label=name)
        _tidy_logarithmic(axes, [s.cot for s in front.solutions] + [c for _, c in points.values()])
        axes.set(xlabel="speed (m/s)", ylabel="cost of transport (E+, no regeneration)")
        axes.legend(frameon=False, fontsize=8)
        figure.savefig(path, dpi=150)
        plt.close(figure)


def animate(
    path: Path,
    params: WheelParams,
    walk: Walk,
    *,
    fps: int = 25,
    size: tuple[int, int] = (600, 360),
    progress: bool = False,
) -> None:
    """A GIF of a walk, drawn by the environment's own renderer, with its running CoT."""
    stride = round(1 / (fps * CONTROL_PERIOD))
    energy, distance = np.cumsum(walk.energies), np.cumsum(walk.distances)
    frames, trail = [], list[tuple[float, float]]()
    for i in tqdm(
        range(0, len(walk.states), stride), desc="animation", disable=not progress, leave=False
    ):
        state, since = walk.states[i], max(0, i - 200)
        travelled, time = distance[i] - distance[since], (i - since) * CONTROL_PERIOD
        moving = travelled > 0.1
        scene = Scene(
            phi=float(state[PHI]),
            theta=float(state[THETA]),
            mode=int(state[MODE]),
            foot_x=float(state[FOOT]) * params.step_length,
            voltage=float(walk.voltages[i]),
            time=i * CONTROL_PERIOD,
            speed=float(travelled / time) if moving else None,
            cot=float((energy[i] - energy[since]) / (params.weight * travelled))
            if moving
            else None,
        )
        trail.append(scene.hub(params))
        frames.append(draw(params, scene, size=size, trail=trail[-40:]))
    save_gif(frames, path, fps)


def _broken(x: Floats, y: Floats, jump: float) -> tuple[Floats, Floats]:
    """The curve with gaps where x jumps by more than `jump` (a touchdown, a turn of the circle)."""
    places = np.flatnonzero(np.abs(np.diff(x)) > jump) + 1
    return np.insert(x, places, np.nan), np.insert(y, places, np.nan)


def _tidy_logarithmic(axes: Axes, values: Sequence[float]) -> None:
    finite = [value for value in values if math.isfinite(value) and value > 0]
    axes.set_yscale("log")
    ticks = [t for t in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5) if t <= 2 * max(finite)]
    ticks = [t for t in ticks if t >= min(finite) / 2]
    axes.set_yticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()


_STYLE: Any = {  # matplotlib types its keys one by one
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.grid": True,
    "grid.color": "#e6eaef",
}
