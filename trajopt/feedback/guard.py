"""A guard that keeps the stance foot pressed down, whatever the law behind it asks for."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from rimless_gym.checks import real, real_array, require_callable, require_kind
from rimless_gym.equations import SINGLE
from rimless_gym.hybrid import foot_force
from rimless_gym.jit import cached, inner
from rimless_gym.params import WheelParams
from trajopt.feedback.law import Controller, Floats, states_and_modes
from trajopt.feedback.requirements import require_machine
from trajopt.gaits.solution import Solution

#: Share of the weight with which the guard keeps the stance foot pressed down.
CONTACT_MARGIN = 0.1

#: The margin is at most this share of the gait's own least normal force: a guard must not act on
#: the gait itself.
SHARE_OF_LEAST = 0.6


@dataclasses.dataclass(frozen=True)
class Guarded:
    """A law whose voltage is changed only as far as the stance foot's contact requires.

    The normal force is monotonic in the voltage, so the voltages that keep it above a margin are a
    half line. Far from its gait, a law that knows nothing of contact would lose it now and then.

    Attributes:
        params: the machine.
        controller: the law to guard.
        margin: least normal force in units of the weight, where a voltage within the limit can
            provide it; at least 0, and less than 1.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: the margin is out of range, or the law is for another machine.
    """

    params: WheelParams
    controller: Controller
    margin: float = CONTACT_MARGIN

    def __post_init__(self) -> None:
        require_kind("params", self.params, WheelParams)
        require_callable("controller", self.controller)
        require_machine("controller", self.controller, self.params)
        if not 0.0 <= real("margin", self.margin) < 1.0:
            raise ValueError(
                f"margin = {self.margin}: must be at least 0 and less than 1, the wheel's weight"
            )

    def __call__(self, x: ArrayLike, mode: ArrayLike = SINGLE) -> Floats:
        """Voltages for states; arguments, result and errors are those of a `Law`.

        Raises:
            TypeError, ValueError: see `Law`; or the controller gives NaN or another shape.
        """
        states, modes = states_and_modes(x, mode)
        volts = _volts(self.controller(states, modes), states)
        p, floor = self.params, self.margin * self.params.weight
        guarded: Floats = _guard(states, modes, volts, floor, p.voltage_limit, p.constants)
        return guarded if np.ndim(x) == 2 else guarded[0]


def _volts(given: ArrayLike, states: Floats) -> Floats:
    """What a controller gave for states, if it is one voltage for each."""
    volts = real_array("the controller's voltages", given)
    if volts.shape != (len(states),):
        raise ValueError(
            f"controller: gave voltages of shape {volts.shape} for states of shape "
            f"{states.shape}; must have shape ({len(states)},)"
        )
    if np.isnan(volts).any():
        raise ValueError(
            f"controller: gave NaN for the state {states[np.isnan(volts)][0]}; must give volts"
        )
    return np.asarray(volts, dtype=np.float64)


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
