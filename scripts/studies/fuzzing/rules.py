"""What must be true of every step, whatever the machine and the motion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rimless_gym import WheelParams
from rimless_gym.energy import balance
from rimless_gym.envs.layout import OBSERVATION_BOUND
from rimless_gym.envs.task import TERM_NAMES
from rimless_gym.equations import DOUBLE, LOSSES, equations
from rimless_gym.hybrid import CONTROL_PERIOD, MAX_RATE
from rimless_gym.kernel.attempt import LEAST_PEAK, peak
from rimless_gym.kernel.stepping import DPHI, DTHETA, MODE, PHI, THETA
from rimless_gym.params import Constants

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

#: Largest residual of a ledger, relative to the energies in it. The steps that
#: `rimless_gym.kernel.attempt` chooses come this near to it on the most violent machines.
RESIDUAL = 1e-7

#: How far a leg may be beyond its touchdown angle (rad).
BELOW_GROUND = 1e-12

#: Figures that are infinite if nothing presses on the ground.
_INFINITE = ("min_normal_force", "friction_demand", "impulse_friction_demand")

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)


def followed(params: WheelParams) -> bool:
    """Whether the kernel's steps are short enough for the highest peaks of the accelerations."""
    with np.errstate(divide="ignore"):
        return bool(peak(params.constants) >= LEAST_PEAK)


class Rules:
    """The rules for the rows of a vector environment.

    Args:
        machines: of the rows.
    """

    def __init__(self, machines: Sequence[WheelParams]) -> None:
        self._p = Constants(*np.stack([m.constants_array for m in machines], axis=1))
        self._weight = np.array([m.weight for m in machines])
        self._stalled = np.array([m.voltage_limit**2 / m.armature_resistance for m in machines])
        self._torque = np.array([m.voltage_limit for m in machines]) * self._p.K * self._p.G
        self._followed = np.array([followed(m) for m in machines])
        self._dissipates = np.array([m.impact_law == "plastic" for m in machines])

    def residuals(self, before: Floats, info: Mapping[str, Any]) -> Floats:
        """The energy that each ledger leaves unexplained, relative to the energies in it, (N,).

        Because angles are rounded, the work of the motor's stall torque over a radian counts as one
        of the energies. The residual is 0 for machines that are not `followed`.
        """
        p, (phi, theta, dphi, dtheta) = self._p, before[:, :4].T
        moving = _eq.kinetic_energy(phi, theta, dphi, dtheta, p)
        high = (p.S1 + p.S2) * np.hypot(p.gx, p.gy)
        terms = balance(info)
        scale, residual = moving + high + self._torque + sum(map(np.abs, terms)), sum(terms)
        return np.where(self._followed, np.abs(residual) / scale, 0.0 * residual)

    def broken(
        self,
        before: Floats,
        after: Floats,
        running: Bools,
        observations: NDArray[np.float32],
        rewards: Floats,
        info: Mapping[str, Any],
    ) -> Iterator[tuple[str, Any]]:
        """What breaks each rule, as a sentence, and which rows (N,) break it; often none does.

        Args:
            before: hybrid states before the step (N, STATE_SIZE).
            after: hybrid states after it, valid in `running` rows.
            running: whether a row's episode goes on after the step (N,).
            observations: of the step (N, 6).
            rewards: of the step (N,).
            info: of the step.
        """
        p = self._p
        yield "an observation is not finite", ~np.isfinite(observations).all(axis=1)
        outside = np.abs(observations) > OBSERVATION_BOUND
        yield "an observation is outside its space", outside.any(axis=1)
        yield "the reward is not finite", ~np.isfinite(rewards)
        terms = sum(info[name] for name in TERM_NAMES)
        yield "the reward is not the sum of its terms", rewards != terms
        for name, values in info.items():
            if name.startswith(("_", "final")):
                continue
            bad = np.isnan(values) if name in _INFINITE else ~np.isfinite(values)
            yield f"{name} is not a finite number", bad
        with np.errstate(invalid="ignore"):
            residuals = self.residuals(before, info)
        yield f"the ledger's residual is above {RESIDUAL:g}", ~(residuals <= RESIDUAL)
        # A small copper loss is a difference of powers and works that are as large as at stall.
        scale = self._weight * p.L1 + self._stalled * CONTROL_PERIOD + self._torque
        scale = RESIDUAL * scale
        for name in (*LOSSES, "shaft", "electrical_positive", "idle"):
            yield f"{name} is negative", info[name] < -scale
        yield "a plastic touchdown creates energy", self._dissipates & (info["collision"] < -scale)
        short = info["electrical_positive"] - np.maximum(info["electrical"], 0.0)
        yield "electrical_positive is less than electrical", short < -scale
        yield "the interval is too long", info["elapsed"] > CONTROL_PERIOD * (1 + 1e-12)
        cut = running & (info["elapsed"] < CONTROL_PERIOD * (1 - 1e-12))
        yield "the interval is too short", cut
        x = after[:, :4].T
        past = np.maximum(p.a - x[PHI], x[PHI] - p.b)
        yield "a foot is below the ground", running & ~(past <= BELOW_GROUND)
        fast = np.maximum(np.abs(x[DPHI]), np.abs(x[DTHETA]))
        yield "a rate is beyond the model's", running & ~(fast <= MAX_RATE)
        yield "the angle of the pendulum is lost", running & ~np.isfinite(x[THETA])
        standing = after[:, MODE] == DOUBLE
        moved = (x[PHI] != p.a) | (x[DPHI] != 0.0)
        yield "the wheel moves on two feet", running & standing & moved
        pulls = info["force_y"] < -1e-6 * self._weight
        yield "the ground pulls", running & pulls
