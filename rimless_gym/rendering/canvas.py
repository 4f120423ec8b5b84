"""A drawing surface in metres of the ground's frame, with a camera that follows the wheel.

Points are complex numbers, x + iy, with x along the ground and y normal to it.
"""

from __future__ import annotations

import cmath
import copy
import math
from collections.abc import Sequence

from rimless_gym.params import WheelParams
from rimless_gym.rendering._pygame import pygame
from rimless_gym.rendering.colours import Colour
from rimless_gym.rendering.sheet import Sheet


class Canvas(Sheet):
    """A surface whose scale shows the whole machine, pendulum stretched out, at the ground.

    Args:
        params: gives the lengths to fit in and the slope.
        x: position along the ground (m) in the middle of the picture.
        size: width and height in pixels of the finished picture.
        background: colour to begin with.

    Attributes:
        x: as given.
        horizon: distance (pixels) from the upper edge down to the ground, in the middle.
        scale: pixels per metre.
        ends: first and last position along the ground (m) that the picture may show.
    """

    def __init__(
        self, params: WheelParams, x: float, size: tuple[int, int], background: Colour
    ) -> None:
        super().__init__(size, background)
        self.x = x
        reach = max(params.leg_length, params.constants.reach)
        hub_height = params.leg_length * math.cos(params.leg_angle / 2)
        above = 1.07 * (params.leg_length + reach)
        below = max(0.45 * params.leg_length, 1.12 * reach - hub_height)
        self.scale = min(self.height / (above + below), self.width / (2.3 * reach))
        self.horizon = self.height / 2 + self.scale * (above - below) / 2
        self._tilt = cmath.exp(-1j * params.slope)
        half = (self.width / 2 + self.height * abs(self._tilt.imag)) / self.scale
        self.ends = x - half / self._tilt.real, x + half / self._tilt.real

    def pixel(self, point: complex) -> tuple[float, float]:
        """Where a point is on the surface."""
        offset = self.scale * (point - self.x) * self._tilt
        return self.width / 2 + offset.real, self.horizon - offset.imag

    def disc(self, centre: complex, radius: float, colour: Colour) -> None:
        """A filled circle."""
        pygame.draw.circle(self.surface, colour, self.pixel(centre), self.scale * radius)

    def polygon(self, points: Sequence[complex], colour: Colour) -> None:
        """A filled polygon."""
        pygame.draw.polygon(self.surface, colour, [self.pixel(point) for point in points])

    def box(self, corner: complex, opposite: complex, colour: Colour) -> None:
        """A rectangle along the ground."""
        others = complex(corner.real, opposite.imag), complex(opposite.real, corner.imag)
        self.polygon([corner, others[0], opposite, others[1]], colour)

    def ellipse(self, centre: complex, width: float, height: float, colour: Colour) -> None:
        """A filled ellipse along the ground; `width` and `height` are its half axes (m)."""
        turn = [2 * math.pi * k / 40 for k in range(40)]
        self.polygon(
            [centre + complex(width * math.cos(t), height * math.sin(t)) for t in turn], colour
        )

    def bar(
        self, start: complex, end: complex, radius: float, end_radius: float, colour: Colour
    ) -> None:
        """A bar with round ends of the given radii."""
        self.disc(start, radius, colour)
        self.disc(end, end_radius, colour)
        if start != end:
            across = 1j * (end - start) / abs(end - start)
            near, far = radius * across, end_radius * across
            self.polygon([start + near, end + far, end - far, start - near], colour)

    def layer(self) -> Canvas:
        """An empty, transparent canvas of the same place, to be laid over this one."""
        layer = copy.copy(self)
        layer.surface = pygame.Surface((self.width, self.height), pygame.SRCALPHA, 32)
        return layer

    def lay(self, layer: Canvas, opacity: float) -> None:
        """Lay over what is on a layer, as one translucent thing; `opacity` in [0, 1]."""
        drawn = layer.surface.get_bounding_rect()
        layer.surface.set_alpha(round(255 * opacity))
        self.surface.blit(layer.surface, drawn, drawn)
