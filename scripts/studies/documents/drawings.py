"""The picture of docs/physics.md."""

from __future__ import annotations

import cmath
import dataclasses
import io
import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from rimless_gym import THESIS_PHYSICAL
from rimless_gym.rendering.canvas import Canvas
from rimless_gym.rendering.wheel import Scene, draw

INK, TEAL, ORANGE, GREY = "#262f3c", "#009688", "#e5562e", "#76849a"


def coordinates_figure() -> Figure:
    """Angles and lengths, drawn on the renderer's picture.

    Points are complex numbers (m), with the stance foot at 0.
    """
    params = dataclasses.replace(THESIS_PHYSICAL, pendulum_length=0.24, slope=0.14)
    scene, size = Scene(phi=1.08, theta=1.1), (1300, 860)
    canvas = Canvas(params, scene.hub(params)[0], size, (255, 255, 255))
    figure = plt.figure(figsize=(9.2, 6.3), dpi=100)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(draw(params, scene, size=size), interpolation="antialiased")
    axes.set_axis_off()
    axes.set(xlim=(230, 1150), ylim=(795, 165))
    foot, hub, unit = 0j, complex(*scene.hub(params)), params.leg_length

    def pixel(point: complex) -> tuple[float, float]:
        x, y = canvas.pixel(point)
        return x * size[0] / canvas.width, y * size[0] / canvas.width

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


def save(figure: Figure, path: Path, colours: int = 200) -> None:
    """Write a PNG with a palette of `colours`, which keeps the file small."""
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi="figure")
    image = Image.open(drawn).convert("RGB")
    image.quantize(colours, dither=Image.Dither.NONE).save(path, optimize=True)
    plt.close(figure)
