"""A law near its gait, and a catch that brings the wheel there from everywhere else."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.checks import positive
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Controller, Floats, Law, states_and_modes
from trajopt.feedback.orbit import squared_distances
from trajopt.feedback.requirements import require_machine

#: Distance from its gait up to which a law acts, in standard deviations of the gait's own motion.
#: Farther away, fast gaits lose the foot before a law has corrected them. The catch's grid cannot
#: see what is much smaller.
NEAR = 0.13


@dataclasses.dataclass(frozen=True)
class Joined:
    """A law in single stance near its gait, and a catch elsewhere.

    Attributes:
        law: that holds the gait.
        catch: that leads to it.
        near: see `NEAR`; > 0.

    Raises:
        TypeError: `near` is not a number.
        ValueError: it is out of range, or law and catch are for different machines.
    """

    law: Law
    catch: Controller
    near: float = NEAR

    def __post_init__(self) -> None:
        positive("near", self.near)
        require_machine("catch", self.catch, self.params)

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return self.law.params

    def __call__(self, x: ArrayLike, mode: ArrayLike = SINGLE) -> Floats:
        """Voltages for states; arguments, result and errors are those of a `Law`."""
        states, modes = states_and_modes(x, mode)
        far = (modes == DOUBLE) | (squared_distances(states, self.law.data.orbit) > self.near**2)
        volts = np.empty(len(states))
        for controller, these in ((self.law, ~far), (self.catch, far)):
            if these.any():
                volts[these] = controller(states[these], modes[these])
        return volts if np.ndim(x) == 2 else volts[0]
