"""Random motions of several kinds, on which the kernel and the reference are compared."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rimless_gym import WheelParams
from rimless_gym.energy import ROW
from rimless_gym.equations import SINGLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.integration import smooth_states
from rimless_gym.kernel.stepping import DPHI, DTHETA, THETA, advance
from rimless_gym.presets import PRESETS

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Motion:
    """A motion to simulate.

    Attributes:
        params: the machine.
        start: hybrid state (STATE_SIZE,).
        volts: voltages (V), each held for one control interval.
    """

    params: WheelParams
    start: Array
    volts: Array


def hybrid_state(phi: float, theta: float, dphi: float, dtheta: float, mode: int = SINGLE) -> Array:
    """A state of the stepping kernel, on the first foot."""
    return np.array([phi, theta, dphi, dtheta, mode, 0.0])


def walking(name: str, rng: np.random.Generator) -> Motion:
    """The pendulum is held ahead of the hub. Machines with too weak a motor walk downhill."""
    slope = {"THESIS_NOMINAL": 0.1, "PROTOTYPE": 0.45}.get(name, 0.0)
    params, lean = PRESETS[name].replace(slope=slope), rng.uniform(1.0, 1.4)
    start = hybrid_state(params.constants.a, lean, rng.uniform(1.5, 2.5), 0.0)
    state, volts = start[None].copy(), []
    for _ in range(150):
        push = 30 * (lean - state[0, THETA]) - 3 * state[0, DTHETA] + 3 * state[0, DPHI] + 10
        volts.append(np.clip(push, -params.voltage_limit, params.voltage_limit))
        advance(params, state, np.array(volts[-1:]), pull=math.inf)
    return Motion(params, start, np.array(volts))


def falling_back(name: str, rng: np.random.Generator) -> Motion:
    """The wheel falls backward from mid-stance, under random voltages."""
    params = PRESETS[name]
    start = hybrid_state(rng.uniform(1.2, 1.8), rng.uniform(-1, 1), rng.uniform(-4, -2), 0.0)
    return Motion(params, start, rng.uniform(-8, 8, 80))


def rocking(name: str, rng: np.random.Generator) -> Motion:
    """The wheel rocks on two feet under an alternating voltage."""
    params = PRESETS[name]
    volts = params.voltage_limit * np.sin(
        rng.uniform(5, 9) * CONTROL_PERIOD * np.arange(150) + rng.uniform(0, 6)
    )
    start = hybrid_state(params.constants.a + 0.02, rng.uniform(-1.5, 1.5), 0.0, 0.0)
    return Motion(params, start, volts)


def resting(name: str, rng: np.random.Generator) -> Motion:
    """The wheel comes to rest on two feet; then full voltage makes it lift off again."""
    params = PRESETS[name]
    start = hybrid_state(
        params.constants.a + rng.uniform(0.01, 0.05), rng.uniform(-0.3, 0.3), 0.0, 0.0
    )
    sign = rng.choice([-1.0, 1.0])
    return Motion(params, start, np.where(np.arange(150) < 100, 0.0, sign * params.voltage_limit))


def several_touchdowns(name: str, rng: np.random.Generator) -> Motion:
    """Nearly at rest, with three or more touchdowns in the first control interval."""
    params, p = PRESETS[name], PRESETS[name].constants
    while True:
        start = hybrid_state(p.a, rng.uniform(-0.5, 0.5), rng.uniform(0.002, 0.04), 0.0)
        motion = Motion(params, start, rng.uniform(-1, 1, 2))
        rows = advance(params, start[None].copy(), motion.volts[:1], pull=math.inf)
        if rows[0, ROW.touchdowns] >= 3:
            return motion


def grazing(depth: float) -> Callable[[str, np.random.Generator], Motion]:
    """Motions in which the leg turns back when the swing foot is `depth` (m) below the ground.

    The turning point is drawn. Integrating backward from it gives the start, 3 to 7 ms earlier.
    """

    def motion(name: str, rng: np.random.Generator) -> Motion:
        params, p = PRESETS[name], PRESETS[name].constants
        forward = bool(rng.integers(2))
        phi = p.b + depth / params.step_length if forward else p.a - depth / params.step_length
        while True:
            theta, dtheta = rng.uniform(-math.pi, math.pi), rng.uniform(-8, 8)
            u = rng.uniform(-params.voltage_limit, params.voltage_limit)
            before = -rng.uniform(0.003, 0.007)
            *_, y = smooth_states(params, (phi, theta, 0.0, dtheta), u, before, 32)
            turns_back = (y[2] > 0) == forward and abs(y[2]) > 1e-3
            if p.a < y[0] < p.b and turns_back and abs(y[3]) < 40:
                start = hybrid_state(y[0], y[1], y[2], y[3])
                return Motion(params, start, np.array([u]))

    return motion


CASES: dict[str, Callable[[str, np.random.Generator], Motion]] = {
    "walking": walking,
    "falling back": falling_back,
    "rocking": rocking,
    "resting, lift-off": resting,
    "several touchdowns": several_touchdowns,
}
CASES |= {
    f"graze {depth:+.0e} m": grazing(depth) for depth in (1e-5, 1e-7, 1e-9, 1e-11, -1e-11, -1e-9)
}
