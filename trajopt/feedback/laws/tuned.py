"""The LQR with its numbers tuned by evolution on the simulator.

    V = V*(s) + f(s) - (K1(s) + w (K2(s) - K1(s))) (x - x*(s)) - (1 - w) c(s)

as in `trajopt.feedback.laws.lqr`: s is the nearest point of the orbit, w grows from 0 to 1 with the
distance from it, and c keeps to the gait's clock. What is tuned are the coefficients of short
Fourier series in the phase of the gait: f, and one that is added to each of the gains K1 and K2;
the weight of c; and the distance at which K1 and K2 count alike. The linear design knows neither
the voltage limit nor the foot that lifts; walks on the simulator know both (Hansen, Niederberger,
Guzzella and Koumoutsakos, IEEE Trans. Evol. Comput. 2009; Hansen, The CMA evolution strategy: a
tutorial, arXiv:1604.00772).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numba import njit

from rimless_gym.checks import extra
from rimless_gym.energy import ROW
from rimless_gym.equations import SINGLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import (
    MODE,
    advance_batch_at,
    hybrid_states,
    kernel_address,
    machine_arrays,
    scratch,
)
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.orbit import Orbit, has_clock, located
from trajopt.gaits.solution import Solution
from trajopt.pool import cores, progress_bar

with extra("learn"):
    import cma

#: Harmonics of the Fourier series.
HARMONICS = 2

#: Disturbed wheels that a candidate must hold, and generations of candidates. The default takes
#: about a minute.
WHEELS, GENERATIONS = 192, 40

#: Standard deviation of the first candidates: of firm gains, in root mean squares of the LQR's.
SPREAD = 0.1

#: The same unit for gentle gains, and for the added voltage as a share of the limit: what acts on
#: the gait itself soon costs more than it helps.
GENTLE_UNIT, VOLTAGE_UNIT = 0.3, 0.002

#: Series that are tuned: two gains for each of four coordinates, and the voltage.
_SERIES = 9

#: Numbers that are tuned.
COUNT = _SERIES * (2 * HARMONICS + 1) + 2

#: Sizes of the disturbances, from the least to the most, in standard deviations of the gait's own
#: motion.
SIZES = (0.02, 0.2)

#: For how long a disturbed wheel must last (s), and one on the gait walks.
LASTING, WALKING = 1.5, 3.0

#: How much a relative rise of the cost of transport counts, if the loss of all disturbed wheels
#: counts 1.
COST_WEIGHT = 20.0

#: Squared distance from the gait that counts like a fall.
LOST = 0.1


def design(
    solution: Solution,
    wheels: int = WHEELS,
    generations: int = GENERATIONS,
    seed: int = 0,
) -> Law:
    """The law for a gait; it takes a minute or two to tune, and raises what `lqr.design` does.

    Args:
        solution: the gait.
        wheels: see `WHEELS`; >= 1.
        generations: see `GENERATIONS`; >= 0, and 0 is the LQR.
        seed: of the disturbances and of the evolution; >= 0.
    """
    gains = lqr.design(solution).data
    trial = Trial.about(solution, gains.orbit, wheels, seed)

    def law(q: Floats) -> Law:
        return Law(solution.params, lqr.volts, with_numbers(gains, solution.duration, q))

    def loss(q: Floats) -> float:
        return score(law(q), solution, trial)

    rng, best = np.random.default_rng(seed), np.zeros(COUNT)
    options = {
        "CMA_diagonal": True,  # too few generations for a full covariance
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": np.nan,  # numpy's global generator stays as it is
        "verbose": -9,
    }
    strategy, least = cma.CMAEvolutionStrategy(len(best) * [0.0], SPREAD, options), loss(best)
    with (
        ThreadPoolExecutor(cores()) as threads,
        progress_bar("tune", total=generations, unit="generation") as bar,
    ):
        for _ in range(generations):
            candidates = strategy.ask()
            losses = list(threads.map(loss, candidates))
            strategy.tell(candidates, losses)
            first = int(np.argmin(losses))
            if losses[first] < least:
                best, least = np.array(candidates[first]), losses[first]
            bar.set_postfix(loss=f"{least:.4f}")
            bar.update()
    return law(best)


def with_numbers(gains: lqr.LqrGains, duration: float, numbers: Floats) -> lqr.LqrGains:
    """The LQR's gains changed by tuned numbers; zeros leave the LQR as it is.

    Args:
        gains: the LQR's.
        duration: of the gait's stride (s).
        numbers: shape (COUNT,). Coefficients (2 harmonics + 1) of nine series, each a constant and
            a cosine and a sine of each harmonic: four added to the gains on the gait, four to those
            away from it, one to the voltage. Then the logarithms of two factors: of the clock's
            gain, and of the distance at which both gains count alike.
    """
    on, off, voltage = np.split(numbers[:-2].reshape(_SERIES, -1), [4, 8])
    timing, blend = numbers[-2:]
    angle = 2 * np.pi * gains.orbit.times / duration
    waves = [np.ones_like(angle)]
    for k in range(1, HARMONICS + 1):
        waves += [np.cos(k * angle), np.sin(k * angle)]
    series = np.array(waves).T
    gentle, firm = (np.sqrt(np.mean(each**2, axis=0)) for each in (gains.gentle, gains.firm))
    volts = VOLTAGE_UNIT * gains.orbit.limit
    return gains._replace(
        voltages=gains.voltages + volts * (series @ voltage[0]),
        gentle=gains.gentle + GENTLE_UNIT * gentle * (series @ on.T),
        firm=gains.firm + firm * (series @ off.T),
        timing=gains.timing * np.exp(timing),
        blend=gains.blend * np.exp(blend),
    )


class Trial(NamedTuple):
    """The states from which laws walk."""

    gait: Floats  # hybrid states on the gait, shape (STATE_SIZE, n)
    disturbed: Floats  # hybrid states about it, shape (STATE_SIZE, m)

    @classmethod
    def about(cls, solution: Solution, orbit: Orbit, wheels: int, seed: int) -> Trial:
        """The states of a seed: as many disturbed ones as `wheels`, and 1/8 as many on the gait."""
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


class TrialWalks(NamedTuple):
    """The outcome for n wheels."""

    lasted: Floats  # share of the time until the fall, shape (n,)
    energy: Floats  # electrical, without regeneration (J), shape (n,)
    distance: Floats  # net (m), shape (n,)
    # squared distance from the gait at the end; infinite after a fall, and in double stance, where
    # no gait is; shape (n,)
    off: Floats


def walked(law: Law, states: Floats, duration: float) -> TrialWalks:
    """Let a law walk from hybrid states (STATE_SIZE, n)."""
    ticks = round(duration / CONTROL_PERIOD)
    machine = machine_arrays([law.params])
    columns = np.ascontiguousarray(states).copy()
    inputs = columns, law.compiled, law.data, ticks, *machine, scratch(), kernel_address()
    return TrialWalks(*_walked(*inputs))


@njit(error_model="numpy", nogil=True)
def _walked(states, law, data, ticks, constants, poles, work, kernel):  # type: ignore[no-untyped-def]
    n = states.shape[1]
    lasted, energy, distance = np.zeros(n), np.zeros(n), np.zeros(n)
    off, volts, out = np.full(n, np.inf), np.empty(n), np.empty((len(ROW), n))
    wheel, count, limit = np.arange(n), n, data.orbit.limit
    for _ in range(ticks):
        for i in range(count):
            u = law(states[:4, i], states[MODE, i], data)
            volts[i] = min(max(u, -limit), limit)
        advance_batch_at(
            kernel,
            (
                *(constants, poles, states, volts, np.int64(0), count),
                *(CONTROL_PERIOD, 0.0, out, work),
            ),
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
    """
    disturbed = walked(law, trial.disturbed, LASTING)
    gone = np.isinf(disturbed.off)
    away = np.minimum(np.where(gone, 0.0, disturbed.off) / LOST, 1.0)
    lost = np.where(gone, 1.0 + 0.5 * (1.0 - disturbed.lasted), away).mean()
    gait = walked(law, trial.gait, WALKING)
    if np.isinf(gait.off).any() or gait.distance.sum() <= 0.0:
        return float(lost + COST_WEIGHT)
    params = solution.params
    energy = gait.energy.sum() + params.idle_power * WALKING * len(gait.energy)
    cost = energy / (params.weight * gait.distance.sum())
    return float(lost + COST_WEIGHT * (cost / solution.cot - 1.0))
