"""Random machines, starts, disturbances and voltages, all from as wide a range as is accepted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rimless_gym import Disturbances, Pushes, SensorNoise, WheelParams
from rimless_gym.envs.starts import draw_start, normal_force
from rimless_gym.equations import DOUBLE, IMPACT_LAWS, MODE_NAMES, SINGLE
from rimless_gym.hybrid import MAX_RATE
from rimless_gym.kernel.stepping import require_steppable
from rimless_gym.params import MOTOR_MOUNTS
from rimless_gym.presets import PRESETS

Floats = NDArray[np.float64]
Generator = np.random.Generator

#: The range of each parameter, drawn evenly in its logarithm. Those of `_MAY_BE_ZERO` are sometimes
#: 0 instead.
_WIDE = {
    "wheel_mass": (1e-2, 1e2),
    "wheel_inertia": (1e-5, 1e2),
    "leg_length": (0.02, 20.0),
    "pendulum_mass": (1e-2, 1e2),
    "pendulum_inertia": (1e-5, 1e2),
    "pendulum_length": (1e-3, 10.0),
    "motor_constant": (1e-4, 1.0),
    "gear_ratio": (1.0, 3e3),
    "armature_resistance": (1e-2, 1e2),
    "rotor_inertia": (1e-9, 1e-4),
    "hub_damping": (1e-6, 10.0),
    "hub_friction": (1e-3, 10.0),
    "gear_loss": (1e-3, 0.9),
    "friction_width": (1e-2, 1.0),
    "drag": (1e-4, 10.0),
    "idle_power": (1e-3, 10.0),
    "gravity": (0.1, 30.0),
    "friction": (1e-2, 10.0),
    "voltage_limit": (0.1, 1e3),
}
_MAY_BE_ZERO = (
    *("wheel_mass", "wheel_inertia", "pendulum_mass", "pendulum_inertia", "pendulum_length"),
    *("motor_constant", "rotor_inertia", "hub_damping", "drag", "idle_power", "friction"),
    *("hub_friction", "gear_loss"),
)
_CANDIDATES = 64  # states drawn for the start of one row


def machine(rng: Generator, laws: Sequence[str] = IMPACT_LAWS) -> WheelParams:
    """A machine that the environment accepts and finds starts for.

    Half of them are like a preset, and half have any parameters.

    Args:
        rng: of the draw.
        laws: impact laws to choose from.
    """
    while True:
        fields = _like_a_preset(rng) if rng.random() < 0.5 else _like_none(rng)
        fields["impact_law"] = str(rng.choice(laws))
        try:
            params = WheelParams(**fields)
            require_steppable(params)
            for _ in range(3):
                draw_start(params, rng)
        except (ValueError, RuntimeError):
            continue
        return params


def _kinds(rng: Generator) -> dict[str, Any]:
    return {
        "n_legs": int(rng.choice([3, 4, 5, 6, 8, 12, 30, 300], p=[0.2, 0.2, 0.2, *[0.08] * 5])),
        "slope": float(rng.choice([0.0, rng.uniform(-0.1, 0.1), rng.uniform(-0.7, 0.7)])),
        "motor_mount": str(rng.choice(MOTOR_MOUNTS)),
    }


def _like_a_preset(rng: Generator) -> dict[str, Any]:
    fields = PRESETS[str(rng.choice(list(PRESETS)))].to_dict()
    for name in _WIDE:
        fields[name] *= math.exp(rng.normal(0.0, 0.3))
    for name in ("rotor_inertia", "hub_damping", "hub_friction", "drag", "idle_power"):
        if rng.random() < 0.3:
            fields[name] = _wide(rng, name)
    if fields["hub_friction"] > 0 and rng.random() < 0.5:
        fields["gear_loss"] = _wide(rng, "gear_loss")
    return fields | _kinds(rng)


def _like_none(rng: Generator) -> dict[str, Any]:
    fields = {name: _wide(rng, name) for name in _WIDE}
    for name in _MAY_BE_ZERO:
        if rng.random() < 0.15:
            fields[name] = 0.0
    return fields | _kinds(rng)


def _wide(rng: Generator, name: str) -> float:
    return float(np.exp(rng.uniform(*np.log(_WIDE[name]))))


def ranges(rng: Generator, params: WheelParams) -> dict[str, tuple[float, float]]:
    """Ranges, 3 % to each side, of two parameters of a machine."""
    names = rng.choice(["wheel_mass", "pendulum_mass", "leg_length", "gravity", "friction"], 2)
    near = {str(name): getattr(params, name) for name in names}
    return {name: (0.97 * value, 1.03 * value) for name, value in near.items()}


def disturbances(rng: Generator, params: WheelParams) -> Disturbances:
    """Pushes of up to a third of the machine's momentum; perhaps noise, and a delay."""
    momentum = params.total_mass * math.sqrt(params.gravity * params.leg_length)
    blow = float(momentum * rng.uniform(0.0, 0.3))
    delay = sorted(int(d) for d in rng.integers(0, 6, 2))
    return Disturbances(
        pushes=Pushes(rate=float(rng.uniform(0.0, 20.0)), impulse=(0.0, blow)),
        sensor_noise=SensorNoise(leg_angle=0.1, pendulum_rate=5.0) if rng.random() < 0.5 else None,
        actuator_delay=(delay[0], delay[1]),
    )


def start(rng: Generator, params: WheelParams) -> dict[str, Any] | None:
    """Reset options for a state in which the feet press, at any rates; None if none was found."""
    p, n = params.constants, _CANDIDATES
    phi = np.where(rng.random(n) < 0.1, rng.choice([p.a, p.b], n), rng.uniform(p.a, p.b, n))
    theta = rng.uniform(-math.pi, math.pi, n)
    if rng.random() < 0.1:
        theta += 2 * math.pi * rng.integers(-15000, 15000, n)
    dphi = _rates(rng, 3 * math.sqrt(params.gravity / params.leg_length))
    dtheta = _rates(rng, MAX_RATE)
    mode = DOUBLE if rng.random() < 0.25 else SINGLE
    if mode == DOUBLE:
        phi, dphi = np.full(n, p.a), np.zeros(n)
    for candidate in np.stack([phi, theta, dphi, dtheta], axis=1):
        state = np.array([*candidate, mode, 0.0])  # on the first foot
        if normal_force(params, state) > 1e-6 * params.weight:
            return {"state": candidate.tolist(), "mode": MODE_NAMES[mode]}
    return None


def _rates(rng: Generator, scale: float) -> Floats:
    """Rates of any size up to a scale, in both directions."""
    size = scale * 10 ** rng.uniform(-3, 0, _CANDIDATES)
    return np.clip(rng.choice([-1, 1], _CANDIDATES) * size, -MAX_RATE, MAX_RATE)


class Voltages:
    """The rows' commands over time. Each row has a way of commanding, which sometimes changes.

    The ways are: a held voltage, white noise, full voltage of either sign, no voltage, noise beyond
    the limits, and a voltage near the back-EMF, with which the pendulum keeps whirling.

    Args:
        rng: of the commands.
        machines: of the rows.
    """

    def __init__(self, rng: Generator, machines: list[WheelParams]) -> None:
        self._rng = rng
        self._way = rng.integers(0, 6, len(machines))
        self._level = rng.uniform(-1, 1, len(machines))
        self._emf = np.array([m.constants.K / m.voltage_limit for m in machines])
        self._mount = np.array([m.constants.d1 for m in machines])

    def next(self, states: Floats) -> NDArray[np.float32]:
        """Commands (N, 1) at hybrid states (N, STATE_SIZE)."""
        rng, n = self._rng, len(self._way)
        anew = rng.random(n) < 0.04
        self._way[anew] = rng.integers(0, 6, anew.sum())
        self._level[anew] = rng.uniform(-1, 1, anew.sum()) * 10 ** rng.uniform(-4, 0, anew.sum())
        follow = self._emf * (states[:, 3] + self._mount * states[:, 2]) + 0.1 * self._level
        white = rng.uniform(-1, 1, n)
        ways = (
            self._level,
            white,
            np.sign(self._level + 0.5 * white),
            0 * white,
            3 * white,
            follow,
        )
        return np.choose(self._way, ways)[:, None].astype(np.float32)
