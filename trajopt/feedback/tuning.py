"""How good a feedback law is, in one number, by walks on the compiled simulator.

Every law walks from the same states: some on the gait, which measure its cost of transport, and
some disturbed, which measure what it can bear.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from rimless_gym.energy import ROW
from rimless_gym.equations import SINGLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import (
    MODE,
    advance_batch,
    hybrid_states,
    machine_arrays,
    scratch,
)
from trajopt.feedback.clock import has_clock
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.orbit import Orbit, located
from trajopt.feedback.requirements import require_machine
from trajopt.gaits.solution import Solution

#: Sizes of the disturbances, from the least to the most, in standard deviations of the gait's own
#: motion.
SIZES = (0.02, 0.2)

#: For how long a disturbed wheel must last (s), and one on the gait walks.
LASTING, WALKING = 1.5, 3.0

#: How much a relative rise of the cost of transport counts, if the loss of all disturbed wheels
#: counts 1.
DEARNESS = 20.0

#: Squared distance from the gait that counts like a fall.
LOST = 0.1


class Trial(NamedTuple):
    """From where laws walk.

    Attributes:
        gait: hybrid states on the gait, shape (STATE_SIZE, n).
        disturbed: hybrid states about it, shape (STATE_SIZE, m).
    """

    gait: Floats
    disturbed: Floats

    @classmethod
    def about(cls, solution: Solution, orbit: Orbit, wheels: int, seed: int) -> Trial:
        """The states of a seed.

        Args:
            solution: the gait.
            orbit: its table.
            wheels: number of disturbed states, m; there are m / 8 on the gait.
            seed: of the disturbances.
        """
        rng, n = np.random.default_rng(seed), max(wheels // 8, 1)
        even = solution.duration * (np.arange(n) + 0.5) / n
        if has_clock(solution):  # in step with it
            ticks = np.round((even - solution.first_tick) / CONTROL_PERIOD)
            even = solution.first_tick + ticks * CONTROL_PERIOD
        at = solution.duration * rng.uniform(size=wheels)
        ways = rng.normal(size=(wheels, 4))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        least, most = np.log(SIZES)
        sizes = np.exp(rng.uniform(least, most, size=(wheels, 1)))
        disturbed = np.asarray(solution.state(at)) + sizes * ways / np.sqrt(orbit.metric)
        c = solution.params.constants
        disturbed[:, 0] = np.clip(disturbed[:, 0], c.a + 1e-6, c.b - 1e-6)
        starts = (hybrid_states(x, SINGLE).T for x in (solution.state(even), disturbed))
        return cls(*starts)


class Walks(NamedTuple):
    """What became of n wheels.

    Attributes:
        lasted: share of the time until the fall, shape (n,).
        energy: electrical, without regeneration (J), shape (n,).
        distance: net (m), shape (n,).
        off: squared distance from the gait at the end; infinite after a fall, and in double stance,
            where no gait is; shape (n,).
    """

    lasted: Floats
    energy: Floats
    distance: Floats
    off: Floats


def walked(law: Law, states: Floats, duration: float) -> Walks:
    """Let a law walk from hybrid states (STATE_SIZE, n)."""
    ticks = round(duration / CONTROL_PERIOD)
    machine = machine_arrays([law.params])
    columns = np.ascontiguousarray(states).copy()
    return Walks(*_walked(columns, law.compiled, law.data, ticks, *machine, scratch()))


@njit(error_model="numpy", nogil=True)
def _walked(states, law, data, ticks, constants, poles, work):  # type: ignore[no-untyped-def]
    n = states.shape[1]
    lasted, energy, distance = np.zeros(n), np.zeros(n), np.zeros(n)
    off, volts, out = np.full(n, np.inf), np.empty(n), np.empty((len(ROW), n))
    wheel, count, limit = np.arange(n), n, data.orbit.limit
    for _ in range(ticks):
        for i in range(count):
            u = law(states[:4, i], states[MODE, i], data)
            volts[i] = min(max(u, -limit), limit)
        advance_batch(
            *(constants, poles, states, volts, 0, count),
            *(CONTROL_PERIOD, 0.0, out, work),
        )
        for i in range(count - 1, -1, -1):
            w = wheel[i]
            if out[ROW.failure, i] == 0.0:
                lasted[w] += 1.0 / ticks
                energy[w] += out[ROW.electrical_positive, i]
                distance[w] += out[ROW.distance, i]
            else:  # the last wheel that still walks takes its place
                count -= 1
                wheel[i] = wheel[count]
                states[:, i] = states[:, count]
    for i in range(count):
        if states[MODE, i] == SINGLE:
            off[wheel[i]] = located(states[:4, i], data.orbit).squared
    return lasted, energy, distance, off


def score(law: Law, solution: Solution, trial: Trial) -> float:
    """What is to be small: the share of disturbed wheels that are lost, and the cost.

    A wheel that falls counts less the later it falls, and one that walks on counts by its distance
    from the gait; one that ends in double stance counts as lost. From the gait itself, none may
    fall or stand, and they must get ahead.

    Raises:
        ValueError: the law is for another machine than the gait.
    """
    require_machine("law", law, solution.params)
    disturbed = walked(law, trial.disturbed, LASTING)
    gone = np.isinf(disturbed.off)
    away = np.minimum(np.where(gone, 0.0, disturbed.off) / LOST, 1.0)
    lost = np.where(gone, 1.0 + 0.5 * (1.0 - disturbed.lasted), away).mean()
    gait = walked(law, trial.gait, WALKING)
    if np.isinf(gait.off).any() or gait.distance.sum() <= 0.0:
        return float(lost + DEARNESS)
    params = solution.params
    energy = gait.energy.sum() + params.idle_power * WALKING * len(gait.energy)
    cost = energy / (params.weight * gait.distance.sum())
    return float(lost + DEARNESS * (cost / solution.cot - 1.0))
