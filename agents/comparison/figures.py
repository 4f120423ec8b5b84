"""Walks drawn: their limit cycles beside the optimal one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

from agents.comparison.style import COLOURS, INK, STYLE
from rimless_gym.hybrid import CONTROL_PERIOD
from trajopt.feedback.law import Floats
from trajopt.gaits.solution import Solution


def plot_limit_cycles(
    path: Path, gait: Solution, walks: Mapping[str, Floats], seconds: float = 6.0
) -> None:
    """phi against phi' and theta against theta': the optimal cycle, and learned ones over it.

    Args:
        path: of the picture.
        gait: the optimal one.
        walks: name -> states in each control interval, (N, STATE_SIZE).
        seconds: at the end of the walks that are drawn.
    """
    times = np.linspace(0.0, gait.duration, 1500)
    cycles = {"optimal": gait.state(times)}
    for name, walk in walks.items():
        cycles[name] = walk[-round(seconds / CONTROL_PERIOD) :, :4]
    with matplotlib.rc_context(STYLE):
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


def _broken(x: Floats, y: Floats, jump: float) -> tuple[Floats, Floats]:
    """The curve with gaps where x jumps by more than `jump` (a touchdown, a turn of the circle)."""
    places = np.flatnonzero(np.abs(np.diff(x)) > jump) + 1
    return np.insert(x, places, np.nan), np.insert(y, places, np.nan)
