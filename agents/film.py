"""A walk as pictures, drawn by the environment's own renderer."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from agents.recording import STEPS, Recording
from rimless_gym.rendering.canvas import Frame
from rimless_gym.rendering.wheel import Point, draw

#: Over what speed and cost are averaged, in words.
AVERAGED = f"over {STEPS} steps"

#: Seconds through which the hub's trail reaches back.
TRAIL = 1.6

#: Seconds between points of it.
FINE = 0.04


def film(
    walk: Recording, *, fps: float = 25, size: tuple[int, int] = (600, 360)
) -> Iterator[Frame]:
    """Pictures of a walk.

    Args:
        walk: the walk.
        fps: pictures per second of the walk; a state is shown until the next one is due.
        size: width and height in pixels.

    Yields:
        Pixels, uint8 of shape (height, width, 3).
    """
    for time in times(walk.ends, fps):
        scene = dataclasses.replace(walk.scene(time), averaged=AVERAGED)
        yield draw(walk.params, scene, size=size, trail=trail_of(walk, time))


def times(ends: float, fps: float) -> list[float]:
    """When pictures are taken of a walk until it ends (s), one or more."""
    return [k / fps for k in range(max(1, round(ends * fps)))]


def trail_of(walk: Recording, time: float) -> list[Point]:
    """Where the hub has been lately."""
    since = max(walk.begins, time - TRAIL)
    return [walk.pose(t).hub(walk.params) for t in np.arange(time, since - 1e-9, -FINE)[::-1]]
