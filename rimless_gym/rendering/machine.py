"""The wheel and its pendulum, drawn."""

from __future__ import annotations

import cmath
import math

from rimless_gym.equations import DOUBLE
from rimless_gym.params import WheelParams
from rimless_gym.rendering.canvas import Canvas
from rimless_gym.rendering.colours import TRACK, WHITE, Paint, blend
from rimless_gym.rendering.scene import Scene


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
