"""What is behind the wheel: hills, the track with a scale in metres, the hub's path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from rimless_gym.params import WheelParams
from rimless_gym.rendering._pygame import pygame
from rimless_gym.rendering.canvas import Canvas
from rimless_gym.rendering.colours import (
    FACE,
    FAR_HILLS,
    NEAR_HILLS,
    SHADOW,
    STANCE,
    TICKS,
    TRACK,
    Colour,
    blend,
)
from rimless_gym.rendering.scene import Point, Scene


def draw_hills(canvas: Canvas) -> None:
    """Two level ridges in the distance, which move more slowly than the track."""
    for colour, height, parallax in ((FAR_HILLS, 0.34, 0.12), (NEAR_HILLS, 0.17, 0.3)):
        ridge: list[Point] = [(0.0, float(canvas.height))]
        for k in range(49):
            x = canvas.width * k / 48
            s = (x + parallax * canvas.scale * canvas.x) * 7 / canvas.width
            up = 0.6 + 0.25 * math.sin(s + 3 * parallax) + 0.15 * math.sin(2.3 * s)
            ridge.append((x, canvas.horizon - canvas.height * height * up))
        ridge.append((float(canvas.width), float(canvas.height)))
        pygame.draw.polygon(canvas.surface, colour, ridge)


def draw_track(canvas: Canvas, params: WheelParams, scene: Scene) -> None:
    """The track's top and face, the shadows on both, and a scale along the edge."""
    unit, (left, right) = params.leg_length, canvas.ends
    back, edge, bottom = 0.055j * unit, -0.085j * unit, -2j * canvas.height / canvas.scale
    canvas.box(left + edge, right + bottom, FACE)

    hub, _, tip = scene.pendulum(params)
    aside = 0.10 * unit  # of the shadow that the pendulum casts on the face
    if tip.imag < edge.imag - aside:
        top = hub + (tip - hub) * (hub - edge).imag / (hub - tip).imag
        for spread, darkness in ((0.08, 0.35), (0.0625, 0.7), (0.0425, 1.0)):
            radius, colour = spread * unit, blend(FACE, SHADOW, darkness)
            canvas.bar(top + aside, tip + (1 - 0.5j) * aside, radius, radius, colour)

    canvas.box(left + back, right + edge, TRACK)
    for spread, darkness in ((1.0, 0.12), (0.8, 0.24), (0.55, 0.36)):
        colour, middle = blend(TRACK, FACE, darkness), hub.real - 0.015j * unit
        canvas.ellipse(middle, spread * unit, 0.06 * spread * unit, colour)

    spacing = 10.0 ** math.floor(math.log10(0.6 * unit))  # 0.1 m for every preset
    for k in range(math.ceil(left / spacing), math.floor(right / spacing) + 1):
        long = k % 5 == 0
        tick = complex(0.024, -0.13) * unit if long else complex(0.016, -0.06) * unit
        corner = k * spacing - tick.real / 2 + edge
        canvas.box(corner, corner + tick, TICKS)
        if long:
            place = canvas.pixel(k * spacing + edge - 0.17j * unit)
            height = max(canvas.height / 21, canvas.width / 52)
            canvas.text(f"{k * spacing:g} m", place, height, TICKS, "midtop")


def draw_trail(canvas: Canvas, trail: Sequence[Point], behind: Colour) -> None:
    """The hub's path, fading with age into the colour behind it."""
    radius = canvas.height / 180 / canvas.scale
    points = [complex(*point) for point in trail]
    for k, (start, end) in enumerate(pairwise(points), start=1):
        share = k / len(points)
        colour = blend(behind, STANCE, 0.8 * share**1.5)
        canvas.bar(start, end, radius * share, radius * share, colour)
