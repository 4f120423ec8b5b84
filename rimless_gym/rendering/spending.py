"""Where the battery's energy went: a bar for every term, each beginning where the last one ends."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate, pairwise

from rimless_gym.rendering._pygame import pygame
from rimless_gym.rendering.colours import MUTED, PAPER, ROD, RULE, TEXT, Colour
from rimless_gym.rendering.display import Frame
from rimless_gym.rendering.sheet import Sheet, text_width


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
