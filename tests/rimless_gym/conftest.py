"""MuJoCo's model of a machine, for tests that compare with it. No equation of ours is in here."""

from __future__ import annotations

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from rimless_gym.export import to_mjcf
from rimless_gym.params import WheelParams


class FreeWheel:
    """A machine floating free of the ground: what MuJoCo makes of its MJCF.

    Rates are of the joints hub_x, hub_z, wheel and pendulum. Air drag, which MJCF does not
    have, is added as a force on the hub.
    """

    def __init__(self, params: WheelParams) -> None:
        self.params = params
        self.model = mujoco.MjModel.from_xml_string(to_mjcf(params))
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        # MuJoCo's dry friction brakes softly, as a constraint: so hard that it is always sliding.
        self.model.dof_solref[:] = -1.0, -1e12
        self.data = mujoco.MjData(self.model)
        self.wheel = self.model.body("wheel").id
        self.motor = self.model.nu > 0

    def move(self, q: np.ndarray, v: np.ndarray, u: float = 0.0) -> None:
        """Set the state and the voltage."""
        self.data.qpos[:], self.data.qvel[:] = q, v
        if self.motor:
            self.data.ctrl[0] = u
        mujoco.mj_forward(self.model, self.data)

    def inertia(self) -> np.ndarray:
        """Mass matrix (4, 4)."""
        rows = np.zeros((4, 4))
        for row, unit in zip(rows, np.eye(4), strict=True):
            mujoco.mj_mulM(self.model, self.data, row, unit)
        return rows

    def force(self) -> np.ndarray:
        """All generalised forces (4) except those of the ground, so that M v' = force."""
        d, drag = self.data, np.zeros(4)
        drag[:2] = -self.params.drag * np.hypot(*d.qvel[:2]) * d.qvel[:2]
        return d.qfrc_passive + d.qfrc_actuator + d.qfrc_constraint - d.qfrc_bias + drag

    def foot(self, k: int) -> np.ndarray:
        """Position (x, z) of foot k from the first foot; k counts legs forward."""
        return np.array(self.data.site_xpos[k % self.params.n_legs][::2])

    def jacobian(self, k: int) -> np.ndarray:
        """Velocity of foot k, (x, z), per rate: (2, 4)."""
        rows = np.zeros((3, 4))
        mujoco.mj_jacSite(self.model, self.data, rows, None, k % self.params.n_legs)
        return rows[::2]

    def jacobian_rate(self, k: int) -> np.ndarray:
        """Time derivative of `jacobian`."""
        rows, point = np.zeros((3, 4)), self.data.site_xpos[k % self.params.n_legs]
        mujoco.mj_jacDot(self.model, self.data, rows, None, point, self.wheel)
        return rows[::2]

    def stack(
        self,
        q: np.ndarray,
        v: np.ndarray,
        u: np.ndarray,
        feet: tuple[int, ...] = (0,),
        friction: np.ndarray | None = None,
    ) -> SimpleNamespace:
        """Inertia, force, Jacobian of the feet and its rate at N states, along the first axis.

        `friction` is the dry friction's size at each state (N m), by default the machine's.
        """
        levels = np.full(len(q), self.params.hub_friction) if friction is None else friction
        out: dict[str, list] = {"inertia": [], "force": [], "jacobian": [], "jacobian_rate": []}
        for *state, level in zip(q, v, u, levels, strict=True):
            self.model.dof_frictionloss[3] = level
            self.move(*state)
            out["inertia"].append(self.inertia())
            out["force"].append(self.force())
            out["jacobian"].append(np.concatenate([self.jacobian(k) for k in feet]))
            out["jacobian_rate"].append(np.concatenate([self.jacobian_rate(k) for k in feet]))
        return SimpleNamespace(**{name: np.array(values) for name, values in out.items()})


@pytest.fixture(scope="session")
def free_wheel() -> type[FreeWheel]:
    """The class above: ``free_wheel(params)``."""
    return FreeWheel
