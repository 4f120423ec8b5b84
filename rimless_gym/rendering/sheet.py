"""A surface to draw on, larger than the finished picture, for smooth edges."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from rimless_gym.rendering._pygame import pygame
from rimless_gym.rendering.colours import Colour
from rimless_gym.rendering.display import Frame

_SUPERSAMPLING = 3


class Sheet:
    """A surface of one colour.

    Args:
        size: width and height in pixels of the finished picture.
        background: colour to begin with.

    Attributes:
        width, height: size of the surface in its own pixels, larger than that of the picture.
        surface: to draw on.
        size: of the finished picture.
    """

    def __init__(self, size: tuple[int, int], background: Colour) -> None:
        self.size = size
        self.width, self.height = (_SUPERSAMPLING * length for length in size)
        self.surface = pygame.Surface((self.width, self.height), 0, 32)
        self.surface.fill(background)

    def text(
        self, text: str, place: tuple[float, float], height: float, colour: Colour, anchor: str
    ) -> pygame.Rect:
        """Text at `place`, in pixels of the surface; `anchor` names its point that goes there.

        Returns:
            Where it is.
        """
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
