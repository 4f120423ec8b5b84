"""Walks drawn: limit cycles, and the animation."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from tqdm import tqdm

from agents.comparison.style import COLOURS, INK, STYLE
from agents.conditions import Conditions
from agents.policies import Policy
from agents.rollout import Rollout
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import FOOT, MODE, PHI, THETA
from rimless_gym.params import WheelParams
from rimless_gym.rendering.wheel import Scene, draw, save_gif
from trajopt.feedback.law import Floats
from trajopt.gaits.solution import Solution


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
