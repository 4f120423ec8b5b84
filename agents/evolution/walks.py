"""Walks of thousands of policies side by side, in compiled code from start to end.

The simulator is the environment's kernel, and every interval is the environment's: the observation
of the state, an action, its voltage held for 10 ms.
"""

from __future__ import annotations

import dataclasses
import math
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from agents.evolution.policy import SIZE, action
from rimless_gym.energy import ROW
from rimless_gym.envs.layout import observation
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import cached
from rimless_gym.kernel.stepping import (
    DPHI,
    DTHETA,
    MODE,
    PHI,
    THETA,
    advance_batch,
    machine_arrays,
    scratch,
)
from rimless_gym.kernel.tile import LANES
from rimless_gym.params import WheelParams
from rimless_gym.rules import LIMIT_TOLERANCE
from trajopt.feedback.law import Floats
from trajopt.processes import cores

EVOLUTION = "the simulator for evolution (about 15 s)"

#: Most wheels that a thread walks with at a time.
MOST = 512


class Walks(NamedTuple):
    """Walks of P policies from S starts; every field has the shape (P, S).

    All but `lasted` are those of the window, the end of the walk; 0 where it was not reached.

    Attributes:
        lasted: share of the whole time before a fall.
        distance: forward (m).
        energy: electrical, without regeneration and idle energy (J).
        steps: forward, less those backward.
        turned: by the pendulum (rad).
        slipping: control intervals in which the foot would slip.
    """

    lasted: Floats
    distance: Floats
    energy: Floats
    steps: Floats
    turned: Floats
    slipping: Floats


#: Where each field of `Walks` is in the compiled results.
AT = Walks(*range(len(Walks._fields)))


class Duration(NamedTuple):
    """How long walks last.

    Attributes:
        intervals: of control.
        window: the last of them, in which walking is judged.
    """

    intervals: int
    window: int

    @classmethod
    def judged_in_second_half(cls, intervals: int) -> Duration:
        """Walks of so many intervals (at least 2), of which the first half is for getting going."""
        return cls(intervals, intervals // 2)


@dataclasses.dataclass(frozen=True)
class World:
    """A machine to walk with.

    Attributes:
        params: the machine.
        threads: that share the walks; the results do not depend on their number.
    """

    params: WheelParams
    threads: int = dataclasses.field(default_factory=cores)

    def walk(self, weights: Floats, starts: Floats, duration: Duration) -> Walks:
        """Let policies (P, SIZE) walk from hybrid states (S, STATE_SIZE)."""
        n_policies, n_starts = len(weights), len(starts)
        assert weights.shape == (n_policies, SIZE)
        n = n_policies * n_starts
        results = np.zeros((len(Walks._fields), n))
        params, machine = self.params, machine_arrays([self.params])
        slipping = params.friction * (1.0 + LIMIT_TOLERANCE)
        block = min(MOST, LANES * math.ceil(n / (LANES * self.threads)))

        def part(begin: int) -> None:
            which = np.arange(begin, min(begin + block, n))
            columns = np.ascontiguousarray(starts[which % n_starts].T)
            of_wheel = np.ascontiguousarray(weights[which // n_starts])
            results[:, which] = _walk(
                *(columns, of_wheel, duration.intervals, duration.window),
                *(params.voltage_limit, 2.0 / params.leg_angle, slipping, *machine, scratch()),
            )

        with ThreadPoolExecutor(self.threads) as threads:
            list(threads.map(part, range(0, n, block)))
        return Walks(*results.reshape(-1, n_policies, n_starts))


@cached(EVOLUTION, nogil=True)
def _walk(  # type: ignore[no-untyped-def]
    states, weights, intervals, window, limit, leg_scale, slipping, constants, poles, work
):
    n = states.shape[1]
    found = np.zeros((len(AT), n))
    out, volts, begun = np.empty((len(ROW), n)), np.empty(n), np.zeros(n)
    wheel, count = np.arange(n), n
    for t in range(intervals):
        for i in range(count):
            seen = observation(
                *(states[PHI, i], states[THETA, i], states[DPHI, i], states[DTHETA, i]),
                *(states[MODE, i], leg_scale),
            )
            volts[i] = limit * action(weights, wheel[i], seen)
            if t == intervals - window:
                begun[wheel[i]] = states[THETA, i]
        advance_batch(
            *(constants, poles, states, volts, 0, count),
            *(CONTROL_PERIOD, 0.0, out, work),
        )
        for i in range(count - 1, -1, -1):
            w = wheel[i]
            demand = max(out[ROW.friction_demand, i], out[ROW.impulse_friction_demand, i])
            if out[ROW.failure, i] != 0.0:  # the last wheel that still walks takes its place
                count -= 1
                wheel[i] = wheel[count]
                states[:, i] = states[:, count]
                continue
            found[AT.lasted, w] += 1.0 / intervals
            if t >= intervals - window:
                found[AT.distance, w] += out[ROW.distance, i]
                found[AT.energy, w] += out[ROW.electrical_positive, i]
                found[AT.steps, w] += out[ROW.steps, i]
                found[AT.turned, w] = states[THETA, i] - begun[w]
                found[AT.slipping, w] += 1.0 if demand > slipping else 0.0
    return found
