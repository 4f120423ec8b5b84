"""Panels of a picture that compares walkers: their walks, phase plane and energies.

`draw_several` shows several walkers on one ground: the first solid, the others as ghosts. Below
the track stands the name of each, under its hub; for those out of the picture, with the distance.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise

import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.rendering.canvas import (
    FACE,
    MUTED,
    OPTIMUM,
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
    Point,
    Scene,
    draw_pendulum,
    draw_track,
    draw_trail,
    draw_voltage,
    draw_wheel,
)

#: How much of a ghost is seen.
OPACITY = 0.5

#: Height of a line of text, in parts of the picture's width.
LINE = 1 / 42


@dataclasses.dataclass(frozen=True, kw_only=True)
class Shown:
    """One walker in the picture.

    Attributes:
        name: written under it.
        colour: of its name, and of its ghost.
        scene: where it is; `speed` and `cot` are written beside its name.
        trail: earlier positions of the hub (m), oldest first.
    """

    name: str
    colour: Colour
    scene: Scene
    trail: Sequence[Point] = ()


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

    Returns:
        Pixels, uint8 of shape (height, width, 3).

    Raises:
        ValueError: the names leave no room for the walkers.
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
    draw_trail(canvas, first.trail, PAPER)
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


class PhasePlane:
    """Axes that fit a walk.

    Args:
        params: the machine; it sets the range of the leg angle.
        rates: least and greatest phi' that is to be seen (rad/s).
        cycle: the optimal one, points in order of time; empty: none is drawn.
        size: width and height in pixels.
    """

    def __init__(
        self,
        params: WheelParams,
        rates: tuple[float, float],
        cycle: Sequence[Point],
        size: tuple[int, int],
    ) -> None:
        self._size, self._alpha = size, params.leg_angle
        self._line = 3 * size[1] / 9.5
        angles, margin = (params.constants.a, params.constants.b), 0.07
        self._ranges = [
            (low - margin * (high - low), high + margin * (high - low))
            for low, high in (angles, rates)
        ]
        self._sheet = Sheet(size, PAPER)
        self._plot = pygame.Rect(
            2.6 * self._line,
            0.5 * self._line,
            self._sheet.width - 3.2 * self._line,
            self._sheet.height - 2.4 * self._line,
        )
        self._draw_axes()
        self._draw_curve(cycle, OPTIMUM, 0.16, tapered=False)
        if cycle:
            middles = [(min(values) + max(values)) / 2 for values in zip(*cycle, strict=True)]
            place = self._pixel((middles[0], middles[1]))  # inside the curve, be it a bow or a bowl
            self._sheet.text("optimal cycle", place, 0.9 * self._line, OPTIMUM, "center")
        self._empty = self._sheet.surface.copy()

    def frame(self, trails: Sequence[tuple[Colour, Sequence[Point]]]) -> Frame:
        """The picture, uint8 of shape (height, width, 3).

        Args:
            trails: a colour, and where somebody has been lately, the present last; the first is in
                front.
        """
        self._sheet.surface.blit(self._empty, (0, 0))
        self._sheet.surface.set_clip(self._plot.inflate(self._line, self._line))
        for colour, points in reversed(trails):
            self._draw_curve(points, colour, 0.4, tapered=True)
            if points:
                place = self._pixel(points[-1])
                pygame.draw.circle(self._sheet.surface, PAPER, place, 0.34 * self._line)
                pygame.draw.circle(self._sheet.surface, colour, place, 0.27 * self._line)
        self._sheet.surface.set_clip(None)
        return self._sheet.frame()

    def _pixel(self, point: Point) -> Point:
        """Where a point is on the sheet."""
        across, up = (
            (value - low) / (high - low)
            for value, (low, high) in zip(point, self._ranges, strict=True)
        )
        return (
            self._plot.left + across * self._plot.width,
            self._plot.bottom - up * self._plot.height,
        )

    def _draw_axes(self) -> None:
        sheet, plot, line = self._sheet, self._plot, self._line
        (left, right), (low, high) = self._ranges
        for x in _ticks(left, right):
            place = self._pixel((x, low))
            pygame.draw.line(sheet.surface, RULE, place, (place[0], plot.top), round(line / 25))
            sheet.text(f"{x:.1f}", (place[0], place[1] + 0.2 * line), 0.85 * line, MUTED, "midtop")
        for y in _ticks(low, high):
            place = self._pixel((left, y))
            pygame.draw.line(sheet.surface, RULE, place, (plot.right, place[1]), round(line / 25))
            sheet.text(f"{y:g}", (place[0] - 0.3 * line, place[1]), 0.85 * line, MUTED, "midright")
        middle = plot.centerx, sheet.height - 0.2 * line
        sheet.text("leg angle phi (rad)", middle, 0.9 * line, TEXT, "midbottom")
        label = pygame.transform.rotate(_label("phi' (rad/s)", 0.9 * line), 90)
        sheet.surface.blit(label, label.get_rect(midleft=(0.2 * line, plot.centery)))

    def _draw_curve(
        self, points: Sequence[Point], colour: Colour, width: float, tapered: bool
    ) -> None:
        """A curve, broken at touchdowns; `width` in lines of text, at its end where tapered."""
        for k, (start, end) in enumerate(pairwise(points), start=1):
            if abs(end[0] - start[0]) < self._alpha / 2:
                share = k / len(points) if tapered else 1.0
                thick = max(1, round(width * share * self._line))
                pygame.draw.line(
                    self._sheet.surface, colour, self._pixel(start), self._pixel(end), thick
                )


def _label(text: str, height: float) -> pygame.Surface:
    pygame.font.init()
    return pygame.font.Font(None, round(height)).render(text, True, TEXT)


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers between two, three to six of them."""
    rough = (high - low) / 4
    unit = 10.0 ** math.floor(math.log10(rough))
    step = max(factor * unit for factor in (1, 2, 5) if factor * unit <= rough)
    return [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


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
