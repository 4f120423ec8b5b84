"""Drawings of the model, on pictures by the renderer."""

from __future__ import annotations

import cmath
import io
import math
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from PIL import Image

from rimless_gym import THESIS_PHYSICAL, WheelParams, simulate
from rimless_gym.equations import DOUBLE
from rimless_gym.rendering.canvas import Canvas
from rimless_gym.rendering.wheel import Scene, draw
from scripts.studies.documents.errata import impact_ratios

INK, TEAL, ORANGE, GREY = "#262f3c", "#009688", "#e5562e", "#76849a"


def picture(params: WheelParams, scene: Scene, size: tuple[int, int]) -> tuple[Any, Any]:
    """The renderer's picture, and a function from points on the ground's frame to its pixels.

    Points are complex numbers (m), with the stance foot at 0.
    """
    canvas = Canvas(params, scene.hub(params)[0], size, (255, 255, 255))

    def pixel(point: complex) -> tuple[float, float]:
        x, y = canvas.pixel(point)
        return x * size[0] / canvas.width, y * size[0] / canvas.width

    return draw(params, scene, size=size), pixel


def panel(figure: Figure, place: tuple[float, float, float, float], frame: Any) -> Axes:
    """Axes that show a frame, with its pixels as coordinates.

    Args:
        figure: in which they are.
        place: left, bottom, width, height, in parts of the figure.
        frame: the picture.
    """
    axes = figure.add_axes(place)
    axes.imshow(frame, interpolation="antialiased")
    axes.set_axis_off()
    return axes


def coordinates_figure() -> Figure:
    """Angles and lengths, drawn on the renderer's picture."""
    params = THESIS_PHYSICAL.replace(pendulum_length=0.24, slope=0.14)
    scene, size = Scene(phi=1.08, theta=1.1), (1300, 860)
    frame, pixel = picture(params, scene, size)
    figure = plt.figure(figsize=(9.2, 6.3), dpi=100)
    axes = panel(figure, (0, 0, 1, 1), frame)
    axes.set(xlim=(230, 1150), ylim=(795, 165))
    foot, hub, unit = 0j, complex(*scene.hub(params)), params.leg_length

    def label(text: str, point: complex, colour: str = INK) -> None:
        box = {"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75}
        x, y = pixel(point)
        axes.text(x, y, text, color=colour, fontsize=20, ha="center", va="center", bbox=box)

    def dashed(start: complex, end: complex) -> None:
        ends = zip(pixel(start), pixel(end), strict=True)
        axes.plot(*ends, color=INK, lw=1.2, ls=(0, (4, 3)))

    def arrow(start: complex, end: complex, colour: str) -> None:
        style = {"arrowstyle": "-|>,head_width=0.3,head_length=0.6", "lw": 2, "color": colour}
        axes.annotate("", pixel(end), pixel(start), arrowprops=style | {"shrinkA": 0, "shrinkB": 0})

    def arc(centre: complex, radius: float, start: float, end: float, colour: str) -> None:
        points = [centre + radius * cmath.exp(1j * t) for t in np.linspace(start, end, 80)]
        axes.plot(*zip(*map(pixel, points[:-4]), strict=True), lw=2, color=colour)
        arrow(points[-7], points[-1], colour)

    leg, rod = cmath.exp(1j * (math.pi - scene.phi)), -1j * cmath.exp(1j * scene.theta)
    downward = -1j * cmath.exp(1j * params.slope)
    dashed(foot, -0.3 + 0j)
    dashed(hub, hub - 0.27j)
    arc(foot, 0.13, math.pi, math.pi - scene.phi, TEAL)
    label(r"$\varphi$", 0.165 * cmath.exp(1j * (math.pi - 0.5 * scene.phi)), TEAL)
    arc(hub, 0.13, -math.pi / 2, scene.theta - math.pi / 2, ORANGE)
    label(r"$\theta$", hub + 0.165 * cmath.exp(-0.8j), ORANGE)
    following = params.leg_angle - scene.phi
    arc(hub, 0.33, following, -scene.phi, INK)
    label(r"$\alpha$", hub + 0.37 * cmath.exp(1j * (following - 0.30)))
    label("$L_1$", foot + 0.4 * unit * leg + 0.06, TEAL)
    label("$L_2$", hub + 0.62 * params.pendulum_length * rod + 0.05j * rod, ORANGE)
    label("$m_2, I_2$", hub + 1.95 * params.pendulum_length * rod + 0.075j * rod, ORANGE)
    label("$m_1, I_1$", hub + 0.1 + 0.085j)
    corner = -0.56 + 0.03j
    for end, name in ((0.14, "$x$"), (0.14j, "$y$")):
        arrow(corner, corner + end, INK)
        label(name, corner + 1.22 * end)
    arrow(-0.5 + 0.42j, -0.5 + 0.42j + 0.14 * downward, GREY)
    label("$g$", -0.46 + 0.36j, GREY)
    level, edge = downward * 1j, 0.08 - 0.033j
    axes.plot(*zip(pixel(edge), pixel(edge + 0.33 * level), strict=True), color="white", lw=1.2)
    label(r"$\gamma$", edge + 0.36 * cmath.exp(0.5j * params.slope))
    return figure


def modes_figure() -> Figure:
    """The two stance modes, and the events that lead from one to the other."""
    params = THESIS_PHYSICAL.replace(pendulum_length=0.17)
    figure = plt.figure(figsize=(13, 4.3), dpi=100)
    over = figure.add_axes((0, 0, 1, 1))
    over.set(xlim=(0, 1), ylim=(0, 1))
    over.set_axis_off()
    scenes = (
        (0.155, "single stance", Scene(phi=1.75, theta=0.5)),
        (0.61, "double stance", Scene(phi=params.constants.a, theta=0.25, mode=DOUBLE)),
    )
    for left, name, scene in scenes:
        frame, _ = picture(params, scene, (540, 400))
        panel(figure, (left, 0.15, 0.265, 0.595), frame)
        over.text(left + 0.1325, 0.82, name, fontsize=16, weight="bold", color=INK, ha="center")

    def arrow(start: tuple[float, float], end: tuple[float, float], bend: float) -> None:
        style = {"arrowstyle": "-|>,head_width=0.35,head_length=0.7", "lw": 2, "color": TEAL}
        style |= {"connectionstyle": f"arc3,rad={bend}"}
        over.annotate("", end, start, arrowprops=style)

    def note(x: float, y: float, *lines: str) -> None:
        text = "\n".join(lines)
        over.text(x, y, text, fontsize=12, color=INK, ha="center", va="center", linespacing=1.4)

    arrow((0.425, 0.56), (0.605, 0.56), -0.2)
    note(
        0.515,
        0.80,
        "touchdown that stops",
        "the wheel, or leaves it",
        "< REST_ENERGY with",
        "both feet pressing",
    )
    arrow((0.605, 0.36), (0.425, 0.36), -0.2)
    note(
        0.515,
        0.13,
        "lift-off",
        r"$\ddot\varphi(a) > 0$: forward",
        r"$\ddot\varphi(b) < 0$: backward",
    )
    arrow((0.15, 0.36), (0.15, 0.56), -1.1)
    note(0.075, 0.80, "touchdown:", "forward at $b$,", "backward at $a$")
    note(0.075, 0.17, r"$\varphi^+ = \varphi^- \mp\alpha$", r"$M_{++}v^+ = M_{+-}v^-$")
    note(0.2875, 0.075, r"$\varphi$ and $\theta$ move: $M\dot v = Q$")
    note(0.7425, 0.075, r"only $\theta$ moves: $\dot\varphi = 0$")
    arrow((0.88, 0.45), (0.92, 0.45), 0.0)
    note(0.958, 0.45, "contact", "lost:", "$F_y < 0$", "(either", "mode)")
    return figure


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
