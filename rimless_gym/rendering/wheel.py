"""One drawing of the wheel, used by both environments, videos and reports.

`draw` is a pure function from a `Scene` to an array of pixels and needs no display. The wheel
walks along the edge of a raised track. The pendulum is on the viewer's side of the wheel, so that
a pendulum that reaches below the ground swings past the track's face.

`Window` and `save_gif` (from `rimless_gym.rendering.display`) show and keep the pictures.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
from collections.abc import Sequence
from itertools import pairwise

from rimless_gym.equations import DOUBLE, SINGLE, equations
from rimless_gym.params import WheelParams
from rimless_gym.rendering._pygame import pygame
from rimless_gym.rendering.canvas import Canvas, Colour
from rimless_gym.rendering.display import Frame, Window, save_gif

__all__ = ["Frame", "Scene", "Window", "draw", "save_gif"]

Point = tuple[float, float]
_hub_position = equations(math.sin, math.cos).hub_position  # interpreted: nothing to compile

SKY, FAR_HILLS, NEAR_HILLS = (243, 246, 250), (230, 237, 244), (215, 225, 236)
TRACK, FACE, SHADOW, TICKS = (176, 189, 203), (52, 63, 79), (38, 47, 60), (126, 142, 161)
LEG, LEG_LIGHT, STANCE, STANCE_LIGHT = (44, 56, 74), (92, 109, 133), (0, 150, 136), (94, 208, 194)
ROD, ROD_DARK, ROD_LIGHT = (229, 86, 46), (168, 55, 24), (255, 163, 124)
WHITE, TEXT, FAINT = (255, 255, 255), (38, 47, 60), (118, 132, 150)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scene:
    """What one frame shows.

    Args:
        phi: stance leg's angle from the ground (rad); in double stance the leading leg's.
        theta: pendulum's angle from the ground's normal (rad).
        mode: `rimless_gym.equations.SINGLE` or `DOUBLE`; decides which feet light up.
        foot_x: stance foot's position along the ground (m).
        voltage: motor voltage (V), shown as a bar; None leaves it out, as for the texts below.
        time: time (s), shown as text.
        speed: walking speed (m/s), shown as text.
        cot: cost of transport, shown as text.
    """

    phi: float
    theta: float
    mode: int = SINGLE
    foot_x: float = 0.0
    voltage: float | None = None
    time: float | None = None
    speed: float | None = None
    cot: float | None = None

    def hub(self, params: WheelParams) -> Point:
        """The hub's position in the ground's frame (m), as `draw` takes it in its `trail`."""
        x, y = _hub_position(self.phi, params.constants)
        return self.foot_x + x, y


def draw(
    params: WheelParams,
    scene: Scene,
    *,
    size: tuple[int, int] = (600, 400),
    trail: Sequence[Point] = (),
) -> Frame:
    """The picture of a scene.

    Args:
        params: the machine; its lengths set the scale, its slope tilts the ground.
        scene: what to show.
        size: width and height in pixels.
        trail: earlier positions of the hub in the ground's frame (m), oldest first.

    Returns:
        Pixels, uint8 of shape (height, width, 3).

    Raises:
        ValueError: an angle or position is not finite, or the size is not positive.
    """
    if not all(map(math.isfinite, (scene.phi, scene.theta, scene.foot_x))):
        raise ValueError(f"cannot draw {scene}: phi, theta and foot_x must be finite")
    if min(size) <= 0:
        raise ValueError(f"size = {size}: width and height must be greater than 0")
    canvas = Canvas(params, scene.hub(params)[0], size, SKY)
    _draw_hills(canvas)
    _draw_track(canvas, params, scene)
    _draw_trail(canvas, trail)
    _draw_wheel(canvas, params, scene)
    _draw_pendulum(canvas, params, scene)
    _draw_captions(canvas, params, scene)
    return canvas.frame()


def _blend(a: Colour, b: Colour, share: float) -> Colour:
    """`a` with a share of `b`."""
    red, green, blue = (round(x + share * (y - x)) for x, y in zip(a, b, strict=True))
    return red, green, blue


def _draw_hills(canvas: Canvas) -> None:
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


def _draw_track(canvas: Canvas, params: WheelParams, scene: Scene) -> None:
    """The track's top and face, the shadows on both, and a scale along the edge."""
    unit, (left, right) = params.leg_length, canvas.ends
    back, edge, bottom = 0.055j * unit, -0.085j * unit, -2j * canvas.height / canvas.scale
    canvas.box(left + edge, right + bottom, FACE)

    hub, tip = _pendulum_ends(params, scene)
    aside = 0.10 * unit  # of the shadow that the pendulum casts on the face
    if tip.imag < edge.imag - aside:
        top = hub + (tip - hub) * (hub - edge).imag / (hub - tip).imag
        for spread, darkness in ((0.08, 0.35), (0.0625, 0.7), (0.0425, 1.0)):
            radius, colour = spread * unit, _blend(FACE, SHADOW, darkness)
            canvas.bar(top + aside, tip + (1 - 0.5j) * aside, radius, radius, colour)

    canvas.box(left + back, right + edge, TRACK)
    for spread, darkness in ((1.0, 0.12), (0.8, 0.24), (0.55, 0.36)):
        colour, middle = _blend(TRACK, FACE, darkness), hub.real - 0.015j * unit
        canvas.ellipse(middle, spread * unit, 0.06 * spread * unit, colour)

    spacing = 10.0 ** math.floor(math.log10(0.6 * unit))  # 0.1 m for every preset
    for k in range(math.ceil(left / spacing), math.floor(right / spacing) + 1):
        long = k % 5 == 0
        tick = complex(0.024, -0.13) * unit if long else complex(0.016, -0.06) * unit
        corner = k * spacing - tick.real / 2 + edge
        canvas.box(corner, corner + tick, TICKS)
        if long:
            place = canvas.pixel(k * spacing + edge - 0.17j * unit)
            canvas.text(f"{k * spacing:g} m", place, canvas.height / 21, TICKS, "midtop")


def _draw_trail(canvas: Canvas, trail: Sequence[Point]) -> None:
    """The hub's path, fading with age."""
    radius = canvas.height / 180 / canvas.scale
    points = [complex(*point) for point in trail]
    for k, (start, end) in enumerate(pairwise(points), start=1):
        share = k / len(points)
        colour = _blend(NEAR_HILLS, STANCE, 0.8 * share**1.5)
        canvas.bar(start, end, radius * share, radius * share, colour)


def _draw_wheel(canvas: Canvas, params: WheelParams, scene: Scene) -> None:
    """Legs with rounded feet; those that stand on the ground are lit."""
    unit, hub = params.leg_length, complex(*scene.hub(params))
    bearing = (0, 1) if scene.mode == DOUBLE else (0,)
    for k in reversed(range(params.n_legs)):  # the bearing ones last, in front of the others
        along = unit * cmath.exp(-1j * (scene.phi + k * params.leg_angle))
        colour, light = (STANCE, STANCE_LIGHT) if k in bearing else (LEG, LEG_LIGHT)
        if k in bearing:
            glow = _blend(TRACK, STANCE_LIGHT, 0.8)
            canvas.ellipse(hub + along, 0.15 * unit, 0.035 * unit, glow)
        canvas.bar(hub, hub + 0.94 * along, 0.052 * unit, 0.03 * unit, colour)
        canvas.disc(hub + 0.94 * along, 0.06 * unit, colour)
        lit = 0.016j * along if along.real > along.imag else -0.016j * along  # its upper left
        ends = hub + 0.2 * along + lit, hub + 0.85 * along + lit
        canvas.bar(*ends, 0.011 * unit, 0.006 * unit, light)
    for radius, colour in ((0.155, LEG), (0.125, LEG_LIGHT), (0.11, LEG)):
        canvas.disc(hub, radius * unit, colour)


def _pendulum_ends(params: WheelParams, scene: Scene) -> tuple[complex, complex]:
    """The hub and the pendulum's far end."""
    hub = complex(*scene.hub(params))
    return hub, hub - 1j * params.constants.reach * cmath.exp(1j * scene.theta)


def _draw_pendulum(canvas: Canvas, params: WheelParams, scene: Scene) -> None:
    """The rod, and a bob at its centre of mass whose size shows its share of the mass."""
    unit = params.leg_length
    hub, tip = _pendulum_ends(params, scene)
    light = complex(-0.8, 1.0)  # the direction it comes from
    canvas.bar(hub, tip, 0.056 * unit, 0.046 * unit, ROD_DARK)
    canvas.bar(hub, tip, 0.044 * unit, 0.034 * unit, ROD)
    lit = 0.014 * unit * light
    canvas.bar(hub + lit, tip + lit, 0.010 * unit, 0.008 * unit, ROD_LIGHT)

    bob = hub - 1j * params.pendulum_length * cmath.exp(1j * scene.theta)
    radius = (0.05 + 0.12 * math.sqrt(params.pendulum_mass / params.total_mass)) * unit
    canvas.disc(bob, radius, ROD_DARK)
    canvas.disc(bob, radius - 0.014 * unit, ROD)
    canvas.disc(bob + 0.30 * radius * light, 0.40 * radius, ROD_LIGHT)
    canvas.disc(bob + 0.36 * radius * light, 0.20 * radius, WHITE)
    canvas.disc(hub, 0.07 * unit, ROD_DARK)
    canvas.disc(hub, 0.035 * unit, WHITE)


def _draw_captions(canvas: Canvas, params: WheelParams, scene: Scene) -> None:
    """Speed and cost of transport, time, and the voltage as a bar."""
    line = canvas.height / 13
    x, y = 0.6 * line, 0.5 * line
    for value, text in ((scene.speed, "{:.2f} m/s"), (scene.cot, "CoT {:.3f}")):
        if value is not None:
            canvas.text(text.format(value), (x, y), line, TEXT, "topleft")
            y += 0.85 * line
    if scene.time is not None:
        canvas.text(f"{scene.time:.1f} s", (x, y), 0.7 * line, FAINT, "topleft")
    if scene.voltage is None:
        return
    half, thick = canvas.width / 9, line / 3.2
    middle, top = canvas.width - 0.6 * line - half, 0.6 * line
    share = max(-1.0, min(1.0, scene.voltage / params.voltage_limit))
    whole = pygame.Rect(middle - half, top, 2 * half, thick)
    part = pygame.Rect(min(middle, middle + share * half), top, abs(share) * half, thick)
    zero = pygame.Rect(middle - thick / 8, top - thick / 4, thick / 4, 1.5 * thick)
    pygame.draw.rect(canvas.surface, NEAR_HILLS, whole, border_radius=round(thick / 2))
    pygame.draw.rect(canvas.surface, STANCE if share > 0 else ROD, part)
    pygame.draw.rect(canvas.surface, LEG, zero)
    label = f"{scene.voltage:+.1f} V"
    canvas.text(label, (middle, top + 1.6 * thick), 0.7 * line, FAINT, "midtop")
