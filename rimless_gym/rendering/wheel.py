"""One drawing of the wheel, used by both environments, videos and reports.

`draw` is a pure function from a `Scene` to an array of pixels and needs no display. The wheel
walks along the edge of a raised track. The pendulum is on the viewer's side of the wheel, so that
a pendulum that reaches below the ground swings past the track's face.

`Window` and `save_gif` (from `rimless_gym.rendering.display`) show and keep the pictures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from rimless_gym.params import WheelParams
from rimless_gym.rendering.canvas import Canvas
from rimless_gym.rendering.captions import draw_captions
from rimless_gym.rendering.colours import FACE, NEAR_HILLS, ROD, SKY, STANCE, TRACK, USUAL
from rimless_gym.rendering.display import Frame, Window, save_gif
from rimless_gym.rendering.ground import draw_hills, draw_track, draw_trail
from rimless_gym.rendering.machine import draw_pendulum, draw_wheel
from rimless_gym.rendering.scene import Point, Scene

__all__ = ["FACE", "ROD", "STANCE", "TRACK", "Frame", "Scene", "Window", "draw", "save_gif"]


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
    draw_hills(canvas)
    draw_track(canvas, params, scene)
    draw_trail(canvas, trail, NEAR_HILLS)
    draw_wheel(canvas, params, scene, USUAL)
    draw_pendulum(canvas, params, scene, USUAL)
    draw_captions(canvas, params, scene)
    return canvas.frame()
