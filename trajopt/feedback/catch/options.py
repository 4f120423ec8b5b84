"""What the catch can do from a state: hold one of a few voltages for a moment."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from rimless_gym.energy import ROW
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import advance
from rimless_gym.params import WheelParams
from trajopt.feedback.guard import CONTACT_MARGIN
from trajopt.feedback.law import Floats
from trajopt.processes import cores

#: Voltages to choose from, and control intervals for which one is held.
COUNT, INTERVALS = 9, 4

#: Charge (s) for a foot without any normal force.
CHARGE = 0.5

#: Wheels that are played at a time.
BLOCK = 1 << 15


class Options(NamedTuple):
    """Voltages to choose from.

    Attributes:
        voltages: (V), shape (m,).
        hold: time for which one is held (s).
        margin: least normal force (N) without a charge.
        charge: for no normal force at all, in seconds; less in proportion above that.
    """

    voltages: Floats
    hold: float
    margin: float
    charge: float

    @classmethod
    def of(cls, params: WheelParams) -> Options:
        """Voltages evenly spread between a machine's limits."""
        volts = np.linspace(-params.voltage_limit, params.voltage_limit, COUNT)
        return cls(volts, INTERVALS * CONTROL_PERIOD, CONTACT_MARGIN * params.weight, CHARGE)


class Played(NamedTuple):
    """What becomes of N states.

    Attributes:
        states: afterwards, shape (N, STATE_SIZE).
        cost: time and charges (s), shape (N,); infinite for a fall.
    """

    states: Floats
    cost: Floats


def played(params: WheelParams, options: Options, states: Floats, voltages: Floats) -> Played:
    """Hold voltages (N,) from hybrid states (N, STATE_SIZE)."""
    after, cost = states.copy(), np.empty(len(states))

    def play(begin: int) -> None:
        part = slice(begin, begin + BLOCK)
        out = advance(params, after[part], voltages[part], options.hold)
        lacking = np.clip(1.0 - out[:, ROW.min_normal_force] / options.margin, 0.0, 1.0)
        fallen = out[:, ROW.failure] != 0.0
        cost[part] = np.where(fallen, np.inf, options.hold + options.charge * lacking)

    if len(states) <= BLOCK:
        play(0)
    else:
        with ThreadPoolExecutor(cores()) as threads:
            list(threads.map(play, range(0, len(states), BLOCK)))
    return Played(after, cost)
