"""Panels of a picture that compares walkers: their walks and energies.

`draw_several` shows several walkers on one ground: the first solid, the others as ghosts. Below
the track stands the name of each, under its hub; for those out of the picture, with the distance.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise

import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.rendering.canvas import (
    FACE,
    MUTED,
    PAPER,
    ROD,
    RULE,
    TEXT,
    USUAL,
    WHITE,
    Canvas,
    Colour,
    Frame,
    Paint,
    Sheet,
    blend,
    pygame,
    text_width,
)
from rimless_gym.rendering.wheel import (
    Scene,
    draw_pendulum,
    draw_track,
    draw_voltage,
    draw_wheel,
)

#: How much of a ghost is seen.
OPACITY = 0.5

#: Height of a line of text, in parts of the picture's width.
LINE = 1 / 42


@dataclasses.dataclass(frozen=True, kw_only=True)
class Shown:
    """One walker in the picture: its name, which is written under it, its colour and its scene."""

    name: str
    colour: Colour
    scene: Scene


def draw_several(
    params: WheelParams,
    walkers: Sequence[Shown],
    size: tuple[int, int],
    *,
    lines: int = 1,
    averaged: str = "",
) -> Frame:
    """The picture of some walkers; the camera follows the first.

    Args:
        params: the machine of all.
        walkers: the first, which is drawn solid and whose voltage and time are shown; then ghosts.
        size: width and height in pixels.
        lines: for how many names there is room below the track, at least.
        averaged: over what speeds and costs are averaged, written below them.
    """
    width, height = size
    strip = round(width * LINE * (1.1 * max(lines, len(walkers)) + 0.4))
    if strip >= height:
        raise ValueError(
            f"size = {width} x {height} pixels: the names below the track need {strip} of its "
            "height; make the picture higher or narrower"
        )
    first, *ghosts = walkers
    canvas = Canvas(params, first.scene.hub(params)[0], (width, height - strip), PAPER)
    draw_track(canvas, params, first.scene)
    for ghost in reversed(ghosts):
        layer, paint = canvas.layer(), Paint.of_one(ghost.colour)
        draw_wheel(layer, params, ghost.scene, paint)
        draw_pendulum(layer, params, ghost.scene, paint)
        canvas.lay(layer, OPACITY)
    draw_wheel(canvas, params, first.scene, USUAL)
    draw_pendulum(canvas, params, first.scene, USUAL)
    _draw_figures(canvas, walkers, averaged)
    if first.scene.voltage is not None:
        line = 1.3 * canvas.width * LINE
        draw_voltage(canvas, params, first.scene.voltage, line, RULE, TEXT)
    return np.concatenate([canvas.frame(), _names(canvas, params, walkers, strip)])


def _draw_figures(canvas: Canvas, walkers: Sequence[Shown], averaged: str) -> None:
    """The time, and a line of figures for each walker that has any."""
    line = canvas.width * LINE
    left, y = 0.6 * line, 0.6 * line
    time = walkers[0].scene.time
    if time is not None:
        canvas.text(f"{time:.1f} s", (left, y), line, MUTED, "topleft")
        y += 1.2 * line
    column = left + max(text_width(walker.name, line) for walker in walkers)
    written = False
    for walker in walkers:
        scene = walker.scene
        if scene.speed is None or scene.cot is None:
            continue
        canvas.text(walker.name, (left, y), line, walker.colour, "topleft")
        right = column + 4.4 * line
        canvas.text(f"{scene.speed:.2f} m/s", (right, y), line, TEXT, "topright")
        canvas.text(f"CoT {scene.cot:.3f}", (right + 0.8 * line, y), line, TEXT, "topleft")
        y += 1.05 * line
        written = True
    if written and averaged:
        canvas.text(averaged, (left, y), 0.85 * line, MUTED, "topleft")


def _names(canvas: Canvas, params: WheelParams, walkers: Sequence[Shown], height: int) -> Frame:
    """A strip with the name of every walker under its hub."""
    strip = Sheet((canvas.size[0], height), FACE)
    line, here = strip.width * LINE, walkers[0].scene.hub(params)[0]
    places = []
    for k, walker in enumerate(walkers):
        hub = complex(*walker.scene.hub(params))
        x, away = canvas.pixel(complex(hub.real, 0.0))[0], hub.real - here
        text = walker.name
        if not 0 <= x <= strip.width:
            text += f" {abs(away):.1f} m {'ahead' if away > 0 else 'behind'}"
        y, half = (0.75 + 1.1 * k) * line, text_width(text, line) / 2
        light = blend(walker.colour, WHITE, 0.55)
        middle = min(max(x, half + 0.6 * line), strip.width - half - 0.6 * line)
        places.append((text, middle, y, half, light))
        if x == middle:
            pygame.draw.line(strip.surface, light, (x, 0), (x, y - 0.45 * line), round(0.1 * line))
    for text, middle, y, half, light in places:  # in front of all lines
        back = pygame.Rect(middle - half, y - 0.5 * line, 2 * half, line)
        pygame.draw.rect(strip.surface, FACE, back.inflate(0.3 * line, 0))
        strip.text(text, (middle, y), line, light, "center")
    return strip.frame()


def draw_spending(
    title: str,
    drawn: Mapping[str, tuple[float, Colour]],
    spent: Mapping[str, float],
    full: float,
    size: tuple[int, int],
) -> Frame:
    """The picture, uint8 of shape (height, width, 3).

    Args:
        title: above the bars.
        drawn: name -> energy drawn from a battery (J) and colour of its bar; one or more.
        spent: name -> energy (J), of the first battery. Where they balance, the last bar ends below
            that battery's.
        full: the energy of a full bar (J).
        size: width and height in pixels.
    """
    sheet = Sheet(size, PAPER)
    row = sheet.height / (len(drawn) + len(spent) + 1.5)
    line = min(0.92 * row, sheet.height / 9.5)
    left = 0.8 * line + max(text_width(name, line) for name in (*drawn, *spent))
    right = sheet.width - 3.4 * line
    scale = (right - left) / full
    sheet.text(title, (left, 0.3 * line), 0.9 * line, MUTED, "topleft")
    ends = [0.0, *accumulate(spent.values())]
    bars = [(name, 0.0, energy, colour) for name, (energy, colour) in drawn.items()]
    bars += [
        (name, start, end, ROD) for name, (start, end) in zip(spent, pairwise(ends), strict=True)
    ]
    for k, (name, start, end, colour) in enumerate(bars):
        y = (k + 1.25) * row
        pygame.draw.rect(sheet.surface, RULE, (left, y + 0.45 * row, right - left, 0.1 * row))
        low, width = left + scale * min(start, end), max(scale * abs(end - start), row / 12)
        pygame.draw.rect(sheet.surface, colour, (low, y + 0.14 * row, width, 0.72 * row))
        middle = y + 0.54 * row
        sheet.text(name, (left - 0.4 * line, middle), line, TEXT, "midright")
        sheet.text(f"{end - start:.2f}", (sheet.width - 0.5 * line, middle), line, TEXT, "midright")
    return sheet.frame()
