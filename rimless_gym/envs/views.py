"""Pictures of rows."""

from __future__ import annotations

from rimless_gym.envs.fleet import Fleet
from rimless_gym.envs.layout import MEMORY
from rimless_gym.rendering.canvas import Frame
from rimless_gym.rendering.wheel import Scene, draw


def frame_of(fleet: Fleet, i: int) -> Frame:
    """The picture of row i."""
    params, memory = fleet.machine(i), fleet.memory[:, i]
    scene = Scene(
        phi=memory[MEMORY.phi],
        theta=memory[MEMORY.theta],
        mode=int(memory[MEMORY.mode]),
        foot_x=memory[MEMORY.foot] * params.step_length,
        voltage=memory[MEMORY.voltage],
        time=memory[MEMORY.time],
    )
    return draw(params, scene)
