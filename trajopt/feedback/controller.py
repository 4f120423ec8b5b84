"""What is put around a law: the switch to a start-up controller, and a guard of the contact."""

from __future__ import annotations

import dataclasses
import reprlib

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.hybrid import foot_force
from rimless_gym.jit import cached, inner
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Controller, Floats, Law, require_machine, states_and_modes
from trajopt.feedback.orbit import squared_distances
from trajopt.gaits.solution import Solution

#: Share of the weight with which the guard keeps the stance foot pressed down.
CONTACT_MARGIN = 0.1

#: The guard's margin is at most this share of the gait's own least normal force: a guard must not
#: act on the gait itself.
SHARE_OF_LEAST = 0.6

#: Distance from its gait up to which a law acts, in standard deviations of the gait's own motion.
#: Farther away, fast gaits lose the foot before a law has corrected them. The grid of the start-up
#: controller cannot resolve what is much smaller.
NEAR = 0.13


@dataclasses.dataclass(frozen=True)
class SwitchingController:
    """A law in single stance near its gait, and a start-up controller of its machine elsewhere."""

    law: Law  # near its gait
    startup: Controller  # elsewhere
    near: float = NEAR  # distance from the gait up to which the law acts; > 0

    def __post_init__(self) -> None:
        require_machine("startup", self.startup, self.params)

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return self.law.params

    def __call__(self, x: ArrayLike, mode: ArrayLike = SINGLE) -> Floats:
        """Voltages for states; arguments, result and errors are those of a `Law`."""
        states, modes = states_and_modes(x, mode)
        far = (modes == DOUBLE) | (squared_distances(states, self.law.data.orbit) > self.near**2)
        volts = np.empty(len(states))
        for controller, these in ((self.law, ~far), (self.startup, far)):
            if these.any():
                volts[these] = controller(states[these], modes[these])
        return volts if np.ndim(x) == 2 else volts[0]


@dataclasses.dataclass(frozen=True)
class ContactGuard:
    """A controller whose voltage is changed only as far as the stance foot's contact requires.

    The normal force is monotonic in the voltage, so the voltages that keep it above a margin are a
    half line. Far from its gait, a law that knows nothing of contact would lose it now and then.
    """

    params: WheelParams  # the controller's machine
    controller: Controller  # to guard
    # least normal force in units of the weight, where a voltage within the limit can provide it; at
    # least 0, and less than 1
    margin: float = CONTACT_MARGIN

    def __post_init__(self) -> None:
        require_machine("controller", self.controller, self.params)

    def __call__(self, x: ArrayLike, mode: ArrayLike = SINGLE) -> Floats:
        """Voltages for states, as a `Law`; a ValueError if the controller's are NaN or too few."""
        states, modes = states_and_modes(x, mode)
        volts = np.asarray(self.controller(states, modes), dtype=np.float64)
        if volts.shape != (len(states),) or np.isnan(volts).any():
            raise ValueError(
                f"controller: gave {reprlib.repr(volts)} for {len(states)} states; must give one "
                "voltage for each, and no NaN"
            )
        p, floor = self.params, self.margin * self.params.weight
        guarded: Floats = _guard(states, modes, volts, floor, p.voltage_limit, p.constants)
        return guarded if np.ndim(x) == 2 else guarded[0]


def margin_for(solution: Solution) -> float:
    """The margin with which a law for a gait is guarded, in units of the weight."""
    least = solution.verification.min_normal_force_over_weight
    return min(CONTACT_MARGIN, SHARE_OF_LEAST * least)


@cached()
def _guard(x, mode, volts, floor, limit, p):  # type: ignore[no-untyped-def]
    guarded = np.minimum(np.maximum(volts, -limit), limit)
    for i in range(len(x)):
        if mode[i] != SINGLE or _force(x[i], guarded[i], p) >= floor:
            continue
        best = limit if _force(x[i], limit, p) > _force(x[i], -limit, p) else -limit
        enough = 1.0  # the share of the way to `best` after which the foot presses
        if _force(x[i], best, p) >= floor:
            short = 0.0
            while enough - short > 1e-9:
                middle = 0.5 * (short + enough)
                if _force(x[i], guarded[i] + middle * (best - guarded[i]), p) >= floor:
                    enough = middle
                else:
                    short = middle
        guarded[i] += enough * (best - guarded[i])
    return guarded


@inner
def _force(y, u, p):  # type: ignore[no-untyped-def]
    """Normal force (N) on the stance foot."""
    return foot_force(SINGLE, y[0], y[1], y[2], y[3], u, p)
