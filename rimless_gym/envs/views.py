"""Pictures of rows: one of each, or several in a grid."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rimless_gym.envs.fleet import Fleet
from rimless_gym.envs.interval import TIME, VOLTAGE
from rimless_gym.kernel.stepping import FOOT, MODE, PHI, THETA
from rimless_gym.rendering.wheel import Frame, Scene, draw

FULL, CELL = (600, 400), (300, 200)  # (width, height) in pixels, alone and in a grid
GAP = 4  # pixels between the cells of a grid


def frame_of(fleet: Fleet, i: int, size: tuple[int, int] = FULL) -> Frame:
    """The picture of row i."""
    params, memory = fleet.machine(i), fleet.memory[:, i]
    scene = Scene(
        phi=memory[PHI],
        theta=memory[THETA],
        mode=int(memory[MODE]),
        foot_x=memory[FOOT] * params.step_length,
        voltage=memory[VOLTAGE],
        time=memory[TIME],
    )
    return draw(params, scene, size=size)


def grid(frames: Sequence[Frame]) -> Frame:
    """Frames of one size beside and below each other, row by row, as square as can be.

    Raises:
        ValueError: there are none.
    """
    if not frames:
        raise ValueError("cannot make a grid of no frames")
    columns = math.ceil(math.sqrt(len(frames)))
    lines = math.ceil(len(frames) / columns)
    height, width = (n + GAP for n in frames[0].shape[:2])
    picture = np.full((lines * height - GAP, columns * width - GAP, 3), 255, dtype=np.uint8)
    for k, frame in enumerate(frames):
        y, x = k // columns * height, k % columns * width
        picture[y : y + height - GAP, x : x + width - GAP] = frame
    return picture
