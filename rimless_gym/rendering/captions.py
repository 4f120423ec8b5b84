"""What is written into a picture of the wheel: speed, cost, time; the voltage as a bar."""

from __future__ import annotations

from rimless_gym.params import WheelParams
from rimless_gym.rendering._pygame import pygame
from rimless_gym.rendering.colours import FAINT, LEG, NEAR_HILLS, ROD, STANCE, TEXT, Colour
from rimless_gym.rendering.scene import Scene
from rimless_gym.rendering.sheet import Sheet


def draw_captions(sheet: Sheet, params: WheelParams, scene: Scene) -> None:
    """Whatever of speed, cost of transport, time and voltage the scene has."""
    line = sheet.height / 13
    x, y = 0.6 * line, 0.5 * line
    for value, text in ((scene.speed, "{:.2f} m/s"), (scene.cot, "CoT {:.3f}")):
        if value is not None:
            sheet.text(text.format(value), (x, y), line, TEXT, "topleft")
            y += 0.85 * line
    if scene.cot is not None and scene.averaged:
        sheet.text(scene.averaged, (x, y), 0.7 * line, FAINT, "topleft")
        y += 0.65 * line
    if scene.time is not None:
        sheet.text(f"{scene.time:.1f} s", (x, y), 0.7 * line, FAINT, "topleft")
    if scene.voltage is not None:
        draw_voltage(sheet, params, scene.voltage, line, NEAR_HILLS, FAINT)


def draw_voltage(
    sheet: Sheet, params: WheelParams, volts: float, line: float, trough: Colour, colour: Colour
) -> None:
    """The voltage as a bar in the upper right corner.

    Args:
        sheet: to draw on.
        params: the machine; beyond its limit the bar is full.
        volts: the voltage (V), also written below.
        line: height of a line of text, in pixels of the sheet.
        trough: colour of the empty bar.
        colour: of the text.
    """
    half, thick = sheet.width / 9, line / 3.2
    middle, top = sheet.width - 0.6 * line - half, 0.6 * line
    share = max(-1.0, min(1.0, volts / params.voltage_limit))
    whole = pygame.Rect(middle - half, top, 2 * half, thick)
    part = pygame.Rect(min(middle, middle + share * half), top, abs(share) * half, thick)
    zero = pygame.Rect(middle - thick / 8, top - thick / 4, thick / 4, 1.5 * thick)
    pygame.draw.rect(sheet.surface, trough, whole, border_radius=round(thick / 2))
    pygame.draw.rect(sheet.surface, STANCE if share > 0 else ROD, part)
    pygame.draw.rect(sheet.surface, LEG, zero)
    sheet.text(f"{volts:+.1f} V", (middle, top + 1.6 * thick), 0.7 * line, colour, "midtop")
