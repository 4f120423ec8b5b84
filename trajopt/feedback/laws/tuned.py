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

import numpy as np

from rimless_gym.checks import flag, integer, positive
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.laws import lqr
from trajopt.feedback.tuning import Trial, evolved, score
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
        ValueError: a number is out of its range.
    """
    harmonics = integer("harmonics", harmonics, 0)
    generations = integer("generations", generations, 0)
    seed, count = integer("seed", seed, 0), numbers(harmonics)
    start = lqr.design(solution)
    trial = Trial.about(solution, start.data.orbit, integer("wheels", wheels, 1), seed)

    def law(q: Floats) -> Law:
        return Law(solution.params, lqr.volts, with_numbers(start.data, solution.duration, q))

    best = evolved(
        lambda q: score(law(q), solution, trial),
        count,
        positive("spread", spread),
        generations,
        seed,
        flag("progress", progress),
    )
    return law(best)


def numbers(harmonics: int) -> int:
    """How many numbers are tuned: the series' coefficients, the clock and the distance."""
    return _SERIES * (2 * harmonics + 1) + 2


def with_numbers(gains: lqr.Gains, duration: float, q: Floats) -> lqr.Gains:
    """The LQR's gains changed by tuned numbers; zeros leave them as they are.

    Args:
        gains: the LQR's.
        duration: of the gait's stride (s).
        q: shape (numbers(harmonics),).
    """
    coefficients = q[:-2].reshape(_SERIES, -1)
    angle = 2 * np.pi * gains.orbit.times / duration
    waves = [np.ones_like(angle)]
    for k in range(1, coefficients.shape[1] // 2 + 1):
        waves += [np.cos(k * angle), np.sin(k * angle)]
    series = np.array(waves).T @ coefficients.T
    gentle, firm = (np.sqrt(np.mean(each**2, axis=0)) for each in (gains.gentle, gains.firm))
    more = VOLTAGE_UNIT * gains.orbit.limit * series[:, 8]
    return gains._replace(
        orbit=gains.orbit._replace(voltages=gains.orbit.voltages + more),
        gentle=gains.gentle + GENTLE_UNIT * gentle * series[:, :4],
        firm=gains.firm + firm * series[:, 4:8],
        timing=gains.timing * np.exp(q[-2]),
        between=gains.between * np.exp(q[-1]),
    )
