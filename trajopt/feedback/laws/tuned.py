"""The LQR with its numbers tuned by evolution on the simulator.

    V = V*(s) + f(s) - (K1(s) + w (K2(s) - K1(s))) (x - x*(s)) - (1 - w) c(s)

as in `trajopt.feedback.laws.lqr`: s is the nearest point of the orbit, w grows from 0 to 1 with the
distance from it, and c keeps to the gait's clock. What is tuned are the coefficients of short
Fourier series in the phase of the gait: f, and a series that is added to each of the gains K1 on
the gait and K2 away from it. So are the weight of c and the distance at which K1 and K2 count
alike. The linear design knows neither the voltage limit nor the foot that lifts; walks on the
simulator know both (Hansen, Niederberger, Guzzella and Koumoutsakos, IEEE Trans. Evol. Comput.
2009, tune the gains of a feedback law by evolution).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rimless_gym.checks import flag, integer, positive
from trajopt.feedback.evolution import evolved
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.tuning import Trial, score
from trajopt.gaits.solution import Solution

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


class Numbers(NamedTuple):
    """What is tuned; zeros leave the LQR as it is.

    Attributes:
        gentle: coefficients (4, 2 harmonics + 1) of the series added to each gain on the gait: the
            constant, then a cosine and a sine of each harmonic.
        firm: the same of the gains away from it.
        voltage: those of the added voltage, shape (2 harmonics + 1,).
        timing: logarithm of the factor of the clock's gain.
        blend: logarithm of the factor of the distance at which both gains count alike.
    """

    gentle: Floats
    firm: Floats
    voltage: Floats
    timing: float
    blend: float

    @classmethod
    def of(cls, q: Floats) -> Numbers:
        """Out of one row of numbers, as many as `count` says."""
        gentle, firm, voltage = np.split(q[:-2].reshape(_SERIES, -1), [4, 8])
        return cls(gentle, firm, voltage[0], q[-2], q[-1])

    @staticmethod
    def count(harmonics: int) -> int:
        """How many there are."""
        return _SERIES * (2 * harmonics + 1) + 2


def design(
    solution: Solution,
    harmonics: int = HARMONICS,
    wheels: int = WHEELS,
    generations: int = GENERATIONS,
    spread: float = SPREAD,
    seed: int = 0,
    progress: bool = True,
) -> Law:
    """The law for a gait; it takes a minute or two to tune.

    Args:
        solution: the gait.
        harmonics: see `HARMONICS`; >= 0.
        wheels: see `WHEELS`; >= 1.
        generations: see `GENERATIONS`; >= 0, and 0 is the LQR.
        spread: see `SPREAD`; > 0.
        seed: of the disturbances and of the evolution; >= 0.
        progress: whether to show a progress bar.

    Raises:
        TypeError: an argument is of the wrong type.
        ValueError: a number is out of its range, or the gait failed its verification.
    """
    harmonics = integer("harmonics", harmonics, 0)
    generations = integer("generations", generations, 0)
    seed = integer("seed", seed, 0)
    start = lqr.design(solution)
    trial = Trial.about(solution, start.data.orbit, integer("wheels", wheels, 1), seed)

    def law(q: Floats) -> Law:
        gains = with_numbers(start.data, solution.duration, Numbers.of(q))
        return Law(solution.params, lqr.volts, gains)

    best = evolved(
        lambda q: score(law(q), solution, trial),
        Numbers.count(harmonics),
        positive("spread", spread),
        generations,
        seed,
        flag("progress", progress),
    )
    return law(best)


def with_numbers(gains: lqr.Gains, duration: float, numbers: Numbers) -> lqr.Gains:
    """The LQR's gains changed by tuned numbers.

    Args:
        gains: the LQR's.
        duration: of the gait's stride (s).
        numbers: the tuned ones.
    """
    angle = 2 * np.pi * gains.orbit.times / duration
    waves = [np.ones_like(angle)]
    for k in range(1, len(numbers.voltage) // 2 + 1):
        waves += [np.cos(k * angle), np.sin(k * angle)]
    series = np.array(waves).T
    gentle, firm = (np.sqrt(np.mean(each**2, axis=0)) for each in (gains.gentle, gains.firm))
    volts = VOLTAGE_UNIT * gains.orbit.limit
    return gains._replace(
        voltages=gains.voltages + volts * (series @ numbers.voltage),
        gentle=gains.gentle + GENTLE_UNIT * gentle * (series @ numbers.gentle.T),
        firm=gains.firm + firm * (series @ numbers.firm.T),
        timing=gains.timing * np.exp(numbers.timing),
        blend=gains.blend * np.exp(numbers.blend),
    )
