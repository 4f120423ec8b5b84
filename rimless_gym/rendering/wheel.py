"""One drawing of the wheel, used by both environments, videos and reports.

`draw` is a pure function from a `Scene` to an array of pixels and needs no display. The wheel
walks along the edge of a raised track. The pendulum is on the viewer's side of the wheel, so that
a pendulum that reaches below the ground swings past the track's face.
"""

from __future__ import annotations

import cmath
import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.equations import DOUBLE, SINGLE, equations
from rimless_gym.params import WheelParams
from rimless_gym.rendering.canvas import (
    FACE,
    FAINT,
    FAR_HILLS,
    LEG,
    NEAR_HILLS,
    ROD,
    SHADOW,
    SKY,
    STANCE,
    TICKS,
    TRACK,
    USUAL,
    WHITE,
    Canvas,
    Colour,
    Frame,
    Paint,
    Sheet,
    blend,
    pygame,
)
from rimless_gym.streams import Ground, ground_turns

#: Footholds that are drawn to each side of the stance foot, beyond the picture's ends.
SHOWN = 50

Point = tuple[float, float]
_hub_position = equations(math.sin, math.cos).hub_position  # interpreted: nothing to compile


@dataclasses.dataclass(frozen=True, kw_only=True)
class Scene:
    """What one frame shows.

    Args:
        phi: stance leg's angle from the ground (rad); in double stance the leading leg's.
        theta: pendulum's angle from the ground's normal (rad).
        mode: `rimless_gym.equations.SINGLE` or `DOUBLE`; decides which feet light up.
        foot_x: stance foot's position along the ground (m).
        foot_y: its height (m); 0 on even ground.
        ground: footholds, x + iy (m), in order of x; empty on even ground.
        voltage: motor voltage (V), shown as a bar; None leaves it out, as for the texts below.
        time: time (s), shown as text.
        speed: walking speed (m/s), which `draw_several` shows.
        cot: cost of transport, which `draw_several` shows.
    """

    phi: float
    theta: float
    mode: int = SINGLE
    foot_x: float = 0.0
    foot_y: float = 0.0
    ground: Sequence[complex] = ()
    voltage: float | None = None
    time: float | None = None
    speed: float | None = None
    cot: float | None = None

    def hub(self, params: WheelParams) -> Point:
        """The hub's position in the ground's frame (m)."""
        x, y = _hub_position(self.phi, params.constants)
        return self.foot_x + x, self.foot_y + y

    def pendulum(self, params: WheelParams) -> tuple[complex, complex, complex]:
        """Hub, centre of mass of the pendulum and its far end, x + iy in the ground's frame (m)."""
        hub, along = complex(*self.hub(params)), -1j * cmath.exp(1j * self.theta)
        return hub, hub + params.pendulum_length * along, hub + params.constants.reach * along


def draw(params: WheelParams, scene: Scene, *, size: tuple[int, int] = (600, 400)) -> Frame:
    """The picture of a scene, uint8 of shape (height, width, 3); the slope tilts the ground."""
    canvas = Canvas(params, scene.hub(params)[0], size, SKY)
    draw_hills(canvas)
    draw_track(canvas, params, scene)
    draw_wheel(canvas, params, scene, USUAL)
    draw_pendulum(canvas, params, scene, USUAL)
    line = canvas.height / 13
    if scene.time is not None:
        place = 0.6 * line, 0.5 * line
        canvas.text(f"{scene.time:.1f} s", place, 0.7 * line, FAINT, "topleft")
    if scene.voltage is not None:
        draw_voltage(canvas, params, scene.voltage, line, NEAR_HILLS, FAINT)
    return canvas.frame()


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
    ground = scene.ground or (complex(left), complex(right))
    face = [point + edge for point in reversed(ground)]
    canvas.polygon([*face, left + bottom, right + bottom], FACE)

    hub, _, tip = scene.pendulum(params)
    aside = 0.10 * unit  # of the shadow that the pendulum casts on the face
    if tip.imag < edge.imag - aside:
        top = hub + (tip - hub) * (hub - edge).imag / (hub - tip).imag
        for spread, darkness in ((0.08, 0.35), (0.0625, 0.7), (0.0425, 1.0)):
            radius, colour = spread * unit, blend(FACE, SHADOW, darkness)
            canvas.bar(top + aside, tip + (1 - 0.5j) * aside, radius, radius, colour)

    canvas.polygon([*(point + back for point in ground), *face], TRACK)
    for spread, darkness in ((1.0, 0.12), (0.8, 0.24), (0.55, 0.36)):
        colour, middle = blend(TRACK, FACE, darkness), hub.real - 0.015j * unit
        canvas.ellipse(middle, spread * unit, 0.06 * spread * unit, colour)

    spacing = 10.0 ** math.floor(math.log10(0.6 * unit))  # 0.1 m for every preset
    for k in range(math.ceil(left / spacing), math.floor(right / spacing) + 1):
        long = k % 5 == 0
        tick = complex(0.024, -0.13) * unit if long else complex(0.016, -0.06) * unit
        corner = k * spacing - tick.real / 2 + edge + 1j * height_at(ground, k * spacing)
        canvas.box(corner, corner + tick, TICKS)
        if long:
            place = canvas.pixel(corner + tick.real / 2 - 0.17j * unit)
            height = max(canvas.height / 21, canvas.width / 52)
            canvas.text(f"{k * spacing:g} m", place, height, TICKS, "midtop")


def with_ground(scene: Scene, params: WheelParams, ground: Ground, foot: int) -> Scene:
    """The scene on rough ground, at a foothold; the ground under the hub is at height 0."""
    first, last = min(foot, 0) - SHOWN, max(foot, 0) + SHOWN
    turns = ground_turns(ground, params.leg_angle, first, last)
    places = np.append(0.0, np.cumsum(params.step_length * np.exp(-1j * turns)))
    places -= places[-first]
    at = foot - first
    moved = dataclasses.replace(scene, foot_x=places[at].real, foot_y=places[at].imag)
    shown = places[at - SHOWN : at + SHOWN + 1]
    shown = shown - 1j * height_at(shown, moved.hub(params)[0])
    return dataclasses.replace(moved, foot_y=shown[SHOWN].imag, ground=tuple(shown.tolist()))


def height_at(ground: ArrayLike, x: float) -> float:
    """Height of the ground (m) at x."""
    return float(np.interp(x, np.real(ground), np.imag(ground)))


def draw_wheel(canvas: Canvas, params: WheelParams, scene: Scene, paint: Paint) -> None:
    """Legs with rounded feet; those that stand on the ground are lit."""
    unit, hub = params.leg_length, complex(*scene.hub(params))
    stands = paint.stance, paint.stance_light
    bearing = (0, 1) if scene.mode == DOUBLE else (0,)
    for k in reversed(range(params.n_legs)):  # the bearing ones last, in front of the others
        along = unit * cmath.exp(-1j * (scene.phi + k * params.leg_angle))
        colour, light = stands if k in bearing else (paint.leg, paint.leg_light)
        if k in bearing:
            glow = blend(TRACK, paint.stance_light, 0.8)
            canvas.ellipse(hub + along, 0.15 * unit, 0.035 * unit, glow)
        canvas.bar(hub, hub + 0.94 * along, 0.052 * unit, 0.03 * unit, colour)
        canvas.disc(hub + 0.94 * along, 0.06 * unit, colour)
        lit = 0.016j * along if along.real > along.imag else -0.016j * along  # its upper left
        ends = hub + 0.2 * along + lit, hub + 0.85 * along + lit
        canvas.bar(*ends, 0.011 * unit, 0.006 * unit, light)
    for radius, colour in ((0.155, paint.leg), (0.125, paint.leg_light), (0.11, paint.leg)):
        canvas.disc(hub, radius * unit, colour)


def draw_pendulum(canvas: Canvas, params: WheelParams, scene: Scene, paint: Paint) -> None:
    """The rod, and a bob at its centre of mass whose size shows its share of the mass."""
    unit = params.leg_length
    hub, bob, tip = scene.pendulum(params)
    light = complex(-0.8, 1.0)  # the direction it comes from
    canvas.bar(hub, tip, 0.056 * unit, 0.046 * unit, paint.rod_dark)
    canvas.bar(hub, tip, 0.044 * unit, 0.034 * unit, paint.rod)
    lit = 0.014 * unit * light
    canvas.bar(hub + lit, tip + lit, 0.010 * unit, 0.008 * unit, paint.rod_light)

    radius = (0.05 + 0.12 * math.sqrt(params.pendulum_mass / params.total_mass)) * unit
    canvas.disc(bob, radius, paint.rod_dark)
    canvas.disc(bob, radius - 0.014 * unit, paint.rod)
    canvas.disc(bob + 0.30 * radius * light, 0.40 * radius, paint.rod_light)
    canvas.disc(bob + 0.36 * radius * light, 0.20 * radius, WHITE)
    canvas.disc(hub, 0.07 * unit, paint.rod_dark)
    canvas.disc(hub, 0.035 * unit, WHITE)


def draw_voltage(
    sheet: Sheet, params: WheelParams, volts: float, line: float, trough: Colour, colour: Colour
) -> None:
    """The voltage as a bar in the upper right corner, full at the machine's limit, and as text.

    `line` is the height of a line of text, in pixels of the sheet; `trough` is the empty bar's
    colour, `colour` the text's.
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
