"""Pictures of rows."""

from __future__ import annotations

from rimless_gym.envs.fleet import Fleet
from rimless_gym.envs.interval import TIME, VOLTAGE
from rimless_gym.kernel.stepping import FOOT, MODE, PHI, THETA
from rimless_gym.rendering.wheel import Frame, Scene, draw


def frame_of(fleet: Fleet, i: int) -> Frame:
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
    return draw(params, scene)
