"""Plots of the measured numbers, and how figures are written."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from PIL import Image

from rimless_gym import THESIS_PHYSICAL, simulate
from scripts.studies.documents.drawings import GREY, INK, ORANGE, TEAL
from scripts.studies.documents.machines import impact_ratios


def convergence_figure(table: dict[str, dict[str, Any]]) -> Figure:
    """The integrator's error over its step, with a line of order 8."""
    figure, axes = plt.subplots(figsize=(6.4, 4.2), dpi=110, layout="constrained")
    for (name, result), colour in zip(table.items(), (INK, TEAL, ORANGE), strict=True):
        axes.loglog(result["h"], result["error"], "o-", color=colour, ms=4, label=name)
    h = np.array([0.0125, 0.2])
    axes.loglog(h, 1e-5 * (h / 0.2) ** 8 * 200, "--", color=GREY, lw=1, label="order 8")
    axes.set(xlabel="step (s)", ylabel="error after 0.2 s (PROTOTYPE: 10 ms)", ylim=(1e-15, 1e-2))
    axes.grid(alpha=0.25)
    axes.legend(frameon=False)
    return figure


def rest_figure(rest: dict[str, Any]) -> Figure:
    """The wheel comes to rest: the leg's angle, and the speed at each touchdown."""
    p = THESIS_PHYSICAL.constants
    motion = simulate(THESIS_PHYSICAL, [p.a + 0.05, 0.0, 0.0, 0.0], np.zeros(60), 0.13)
    t = np.linspace(0, 0.13, 2000)
    states, arcs = motion.state(t), motion.arcs
    foot = np.array(
        [arcs[max(np.searchsorted([a.start for a in arcs], s, "right") - 1, 0)].foot for s in t]
    )
    tilt = states[:, 0] - p.a + foot * p.alpha
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.4), dpi=110, layout="constrained")
    left.plot(1e3 * t, 1e3 * tilt, color=INK, lw=1.4)
    left.plot(1e3 * np.array(rest["time"]), np.zeros(rest["touchdowns"]), "o", color=TEAL, ms=5)
    left.axhline(0, color=GREY, lw=0.8, ls=":")
    left.set(xlabel="time (ms)", ylabel="tilt from two feet (mrad)")
    count = np.arange(1, rest["touchdowns"] + 1)
    right.semilogy(count, rest["rate"], "o-", color=TEAL, label=r"$|\dot\varphi^-|$ (rad/s)")
    right.semilogy(count, rest["loss"], "s-", color=ORANGE, label="energy lost (J)")
    right.set(xlabel="touchdown", xticks=count)
    right.legend(frameon=False)
    for axes in (left, right):
        axes.grid(alpha=0.25)
    return figure


def impact_figure() -> Figure:
    """The printed impact map beside the plastic one."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.9), dpi=110, layout="constrained")
    theta = np.linspace(-math.pi, math.pi, 721)
    for law, colour, name in (
        ("plastic", TEAL, "plastic"),
        ("thesis", ORANGE, "(3.82) as printed"),
    ):
        at = [impact_ratios(THESIS_PHYSICAL, law, theta, 1.0, rate)[0] for rate in (-1.0, 0.0, 1.0)]
        left.plot(theta, at[1], color=colour, label=name)
        left.fill_between(theta, at[0], at[2], color=colour, alpha=0.18, lw=0)
    left.axhline(0, color=GREY, lw=0.8)
    left.set(
        xlim=(-math.pi, math.pi),
        xlabel=r"pendulum angle $\theta$ (rad)",
        ylabel=r"$\dot\varphi^+ / \dot\varphi^-$",
    )
    left.legend(frameon=False)
    ratio = np.linspace(-4, 4, 401)
    gain = impact_ratios(THESIS_PHYSICAL, "thesis", theta[None, :], 1.0, ratio[:, None])[1]
    levels = [0, 0.25, 0.5, 0.75, 1, 1.25, 1.5, 1.75, 2, 2.25, 2.5]
    filled = right.contourf(theta, ratio, gain, levels, cmap="RdBu_r", norm=TwoSlopeNorm(1, 0, 2.5))
    right.contour(theta, ratio, gain, [1], colors=INK, linewidths=1)
    figure.colorbar(filled, ax=right, label="kinetic energy after / before, (3.82)")
    right.set(xlabel=r"pendulum angle $\theta$ (rad)", ylabel=r"$\dot\theta^- / \dot\varphi^-$")
    return figure


def save(figure: Figure, path: Path, colours: int = 200) -> None:
    """Write a PNG with a palette of `colours`, which keeps the file small."""
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi="figure")
    image = Image.open(drawn).convert("RGB")
    image.quantize(colours, dither=Image.Dither.NONE).save(path, optimize=True)
    plt.close(figure)
