"""Surfaces to draw on, in pixels and in metres of the ground's frame, and the colours.

They are larger than the finished picture, for smooth edges. Points in metres are complex numbers,
x + iy, with x along the ground and y normal to it.
"""

from __future__ import annotations

import cmath
import copy
import math
import os
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rimless_gym.params import WheelParams

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # it would end up in scripts' JSON output

import pygame

__all__ = ["pygame"]

Frame = NDArray[np.uint8]  # (height, width, 3)
Colour = tuple[int, int, int]

SKY, FAR_HILLS, NEAR_HILLS = (243, 246, 250), (230, 237, 244), (215, 225, 236)
TRACK, FACE, SHADOW, TICKS = (176, 189, 203), (52, 63, 79), (38, 47, 60), (126, 142, 161)
LEG, LEG_LIGHT, STANCE, STANCE_LIGHT = (44, 56, 74), (92, 109, 133), (0, 150, 136), (94, 208, 194)
ROD, ROD_DARK, ROD_LIGHT = (229, 86, 46), (168, 55, 24), (255, 163, 124)
WHITE, TEXT, FAINT = (255, 255, 255), (38, 47, 60), (118, 132, 150)

#: A background that glares neither on a white page nor on a black one.
PAPER = (217, 223, 231)

#: On it: lines and empty bars, and text beside the main thing.
RULE, MUTED = (186, 196, 208), (84, 97, 115)

#: Walkers in one picture: the first, the optimum's ghost, others. Colour-blind people too
#: distinguish blue from vermilion; all are named in the picture.
FIRST, OPTIMUM, OTHERS = (196, 62, 22), (0, 92, 171), ((116, 52, 138), (120, 88, 0))

_SUPERSAMPLING = 3


def blend(a: Colour, b: Colour, share: float) -> Colour:
    """`a` with a share of `b`."""
    red, green, blue = (round(x + share * (y - x)) for x, y in zip(a, b, strict=True))
    return red, green, blue


class Paint(NamedTuple):
    """The colours of legs in the air, of legs that stand, of the pendulum, and of their lights."""

    leg: Colour
    leg_light: Colour
    stance: Colour
    stance_light: Colour
    rod: Colour
    rod_dark: Colour
    rod_light: Colour

    @classmethod
    def of_one(cls, colour: Colour) -> Paint:
        """Shades of one colour: for a ghost."""
        light, dark = blend(colour, WHITE, 0.45), blend(colour, LEG, 0.35)
        return cls(colour, light, dark, light, colour, dark, light)


USUAL = Paint(LEG, LEG_LIGHT, STANCE, STANCE_LIGHT, ROD, ROD_DARK, ROD_LIGHT)


class Sheet:
    """A surface of one colour.

    Attributes:
        size: width and height in pixels of the finished picture.
        width, height: size of the surface in its own pixels, larger than that of the picture.
        surface: to draw on.
    """

    def __init__(self, size: tuple[int, int], background: Colour) -> None:
        self.size = size
        self.width, self.height = (_SUPERSAMPLING * length for length in size)
        self.surface = pygame.Surface((self.width, self.height), 0, 32)
        self.surface.fill(background)

    def text(
        self, text: str, place: tuple[float, float], height: float, colour: Colour, anchor: str
    ) -> pygame.Rect:
        """Text at `place`, in pixels of the surface; `anchor` names its point that goes there."""
        image = _text(text, round(height), colour)
        return self.surface.blit(image, image.get_rect(**{anchor: place}))

    def frame(self) -> Frame:
        """The finished picture, uint8 of shape (height, width, 3)."""
        picture = pygame.transform.smoothscale(self.surface, self.size)
        return np.ascontiguousarray(pygame.surfarray.pixels3d(picture).swapaxes(0, 1))


def text_width(text: str, height: float) -> int:
    """How many pixels wide a text is."""
    return _text(text, round(height), (0, 0, 0)).get_width()


@lru_cache(maxsize=512)
def _text(text: str, height: int, colour: Colour) -> pygame.Surface:
    pygame.font.init()
    return pygame.font.Font(None, height).render(text, True, colour)


class Canvas(Sheet):
    """A surface whose scale shows the whole machine, pendulum stretched out, at the ground.

    Attributes:
        x: position along the ground (m) in the middle of the picture.
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
