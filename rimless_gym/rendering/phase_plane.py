"""The phase plane of the wheel: leg angle against its rate, with the optimal cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from rimless_gym.params import WheelParams
from rimless_gym.rendering._pygame import pygame
from rimless_gym.rendering.colours import MUTED, OPTIMUM, PAPER, RULE, TEXT, Colour
from rimless_gym.rendering.display import Frame
from rimless_gym.rendering.sheet import Sheet

Point = tuple[float, float]  # phi (rad), phi' (rad/s)


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
