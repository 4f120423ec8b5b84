"""The LQR with its numbers tuned by evolution, for machines known only roughly.

    V = V*(s) + f(s) - (K1(s) + w (K2(s) - K1(s))) (x - x*(s))

as in `trajopt.feedback.laws.lqr`: s is the nearest point of the orbit, and w grows from 0 to 1 with
the distance from it. On another machine the LQR forces the nominal orbit, and the volts that hold
the wheel there are copper loss. So machines are drawn, and the mean cost of transport of their
walks is minimised. What is tuned are the coefficients of short Fourier series in the phase of the
gait: f, and one that is added to each of the gains K1 and K2; and the distance at which K1 and K2
count alike. The law has no memory and does not know its machine (Hansen, Niederberger, Guzzella and
Koumoutsakos, IEEE Trans. Evol. Comput. 2009; Hansen, The CMA evolution strategy: a tutorial,
arXiv:1604.00772).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numba import njit

from rimless_gym.checks import extra, integer, real
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
from rimless_gym.params import WheelParams
from rimless_gym.rules import Extremes, violations
from trajopt.feedback.gait_table import law_about
from trajopt.feedback.law import Floats, Law
from trajopt.feedback.laws import lqr
from trajopt.gaits.solution import Solution
from trajopt.identification.fit import machines_within, physical
from trajopt.pool import cores, progress_bar
from trajopt.store import Store, file_digest, key

with extra("learn"):
    import cma

#: Parameters (those in `trajopt.identification.fit.PHYSICAL`) are drawn within this share of the
#: nominal ones.
SHARE = 0.025

#: Laws of a generation, machines that each of them walks with, and generations. The default takes
#: some minutes.
POPULATION, MACHINES, GENERATIONS = 16, 64, 200

#: The law acts from so many times as far away: there the own gaits of other machines lie.
REACH = 2.0

#: Harmonics of the Fourier series.
HARMONICS = 3

#: Standard deviation of the first generation: of gains, in root mean squares of the LQR's.
SPREAD = 0.15

#: The same unit for the added voltage, as a share of the limit.
VOLTAGE_UNIT = 0.01

#: Series that are tuned: two gains for each of four coordinates, and the voltage.
_SERIES = 9

#: Numbers that are tuned.
COUNT = _SERIES * (2 * HARMONICS + 1) + 1

#: Seconds of a walk, and those at its end over which it is measured.
DURATION, WINDOW = 8.0, 4.0

#: One walk in a hundred that is lost weighs as much as 10 % of the energy.
LOSS_WEIGHT = 10.0


def design(solution: Solution, folder: Path | None = None) -> Law:
    """The law for a gait, tuned by `tune`, which takes minutes; it raises the same errors.

    Its numbers are stored in `folder`, if there is one, and read from it if they are there.
    """
    if folder is None:
        return law_with(solution, tune(solution))
    store, first = Store(folder), law_about(solution, ahead=None).data
    gains = (first.gentle, first.firm, first.blend)
    code = file_digest(Path(__file__))
    name = key("tuned", params=solution.params, orbit=first.orbit.states, gains=gains, code=code)
    if name not in store:
        store.save(name, tune(solution))
    return law_with(solution, store.load(name))


def law_with(solution: Solution, numbers: Floats) -> Law:
    """The law for a gait with numbers (COUNT,) that `tune` has found."""
    return with_numbers(law_about(solution, ahead=None), solution.duration, numbers)


def tune(
    solution: Solution,
    share: float = SHARE,
    generations: int = GENERATIONS,
    seed: int = 0,
) -> Floats:
    """The numbers (COUNT,) of the law for a gait.

    Args:
        solution: the gait.
        share: see `SHARE`; in [0, 1).
        generations: see `GENERATIONS`; >= 0, and 0 is the LQR with gentle gains and no clock.
        seed: of the machines, of where on the gait they begin, and of the evolution; >= 0.

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: it is out of its range; or see `lqr.design`, which may raise a RuntimeError,
            too.
    """
    if not 0.0 <= real("share", share) < 1.0:
        raise ValueError(f"share = {share}: must be at least 0 and less than 1")
    integer("generations", generations, 0)
    rng = np.random.default_rng(integer("seed", seed, 0))
    first = law_about(solution, ahead=None)
    options = {
        "popsize": POPULATION,
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": np.nan,  # numpy's global generator stays as it is
        "verbose": -9,
    }
    strategy = cma.CMAEvolutionStrategy(np.zeros(COUNT), SPREAD, options)
    with (
        ThreadPoolExecutor(cores()) as threads,
        progress_bar("tune", total=generations, unit="generation") as bar,
    ):
        for _ in range(generations):
            trial = Trial.drawn(solution, share, rng)
            candidates = strategy.ask()
            laws = [with_numbers(first, solution.duration, each) for each in candidates]
            losses = list(threads.map(trial.loss, laws))
            strategy.tell(candidates, losses)
            bar.set_postfix(loss=f"{np.median(losses):.4f}")
            bar.update()
    return np.asarray(strategy.mean)


def with_numbers(law: Law, duration: float, numbers: Floats) -> Law:
    """The LQR with tuned numbers; zeros leave its voltages as they are.

    Args:
        law: the LQR.
        duration: of the gait's stride (s).
        numbers: shape (COUNT,). Coefficients (2 harmonics + 1) of nine series, each a constant and
            a cosine and a sine of each harmonic: four added to the gains on the gait, four to those
            away from it, one to the voltage. Then the logarithm of the factor of the distance at
            which both gains count alike.
    """
    gains: lqr.LqrGains = law.data
    on, off, voltage = np.split(numbers[:-1].reshape(_SERIES, -1), [4, 8])
    angle = 2 * np.pi * gains.orbit.times / duration
    waves = [np.ones_like(angle)]
    for k in range(1, HARMONICS + 1):
        waves += [np.cos(k * angle), np.sin(k * angle)]
    series = np.array(waves).T
    gentle, firm = (np.sqrt(np.mean(each**2, axis=0)) for each in (gains.gentle, gains.firm))
    data = gains._replace(
        voltages=gains.voltages + VOLTAGE_UNIT * gains.orbit.limit * (series @ voltage[0]),
        gentle=gains.gentle + gentle * (series @ on.T),
        firm=gains.firm + firm * (series @ off.T),
        blend=gains.blend * np.exp(numbers[-1]),
    )
    return dataclasses.replace(law, data=data, reach=REACH)


class Trial(NamedTuple):
    """Machines, and the states on the nominal gait from which they walk."""

    machines: tuple[WheelParams, ...]  # N
    states: Floats  # hybrid states, shape (STATE_SIZE, N)

    @classmethod
    def drawn(cls, solution: Solution, share: float, rng: np.random.Generator) -> Trial:
        """`MACHINES` of them, whose parameters are each drawn within a share of the nominal ones'.

        They begin at times that are drawn, too.
        """
        nominal = solution.params
        draws = rng.uniform(-1.0, 1.0, (MACHINES, len(physical(nominal))))
        machines = machines_within(nominal, share, draws)
        times = solution.duration * rng.uniform(size=MACHINES)
        return cls(machines, hybrid_states(solution.state(times), SINGLE).T)

    def loss(self, law: Law) -> float:
        """The objective to minimise: the logarithm of the mean CoT, and the share of walks lost."""
        costs = walking_costs(law, self.machines, self.states)
        walking = np.isfinite(costs)
        if not walking.any():
            return 2.0 * LOSS_WEIGHT
        return float(np.log(costs[walking].mean()) + LOSS_WEIGHT * (1.0 - walking.mean()))


def walking_costs(law: Law, machines: Sequence[WheelParams], states: Floats) -> Floats:
    """Costs of transport (N,) of a law's walks with N machines from hybrid states (STATE_SIZE, N).

    Infinite where the wheel falls or, in the last `WINDOW`, does not get ahead or breaks a rule of
    `rimless_gym.rules`.
    """
    ticks, measured = round(DURATION / CONTROL_PERIOD), round(WINDOW / CONTROL_PERIOD)
    columns = states.copy()
    inputs = columns, law.compiled, law.data, ticks, ticks - measured
    fallen, energy, distance, *extremes = _walked(
        *inputs, *machine_arrays(machines), scratch(), kernel_address()
    )
    worst = zip(machines, *extremes, strict=True)
    lawful = [not violations(machine, Extremes(*each)) for machine, *each in worst]
    walking = ~fallen & (distance > 0.0) & lawful
    idle = np.array([each.idle_power for each in machines]) * WINDOW
    weights = np.array([each.weight for each in machines])
    costs = np.full(len(machines), np.inf)
    costs[walking] = (energy + idle)[walking] / (weights * distance)[walking]
    return costs


@njit(error_model="numpy", nogil=True)
def _walked(states, law, data, ticks, begin, constants, poles, work, kernel):  # type: ignore[no-untyped-def]
    n = states.shape[1]
    fallen, energy, distance = np.ones(n, np.bool_), np.zeros(n), np.zeros(n)
    force, clearance = np.full(n, np.inf), np.full(n, np.inf)
    demand, impulse = np.zeros(n), np.zeros(n)
    volts, out = np.empty(n), np.empty((len(ROW), n))
    wheel, count, limit = np.arange(n), n, data.orbit.limit
    for k in range(ticks):
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
            if out[ROW.failure, i] != 0.0:  # the last wheel that still walks takes its place
                count -= 1
                wheel[i], poles[i] = wheel[count], poles[count]
                states[:, i], constants[:, i] = states[:, count], constants[:, count]
            elif k >= begin:
                energy[w] += out[ROW.electrical_positive, i]
                distance[w] += out[ROW.distance, i]
                force[w] = min(force[w], out[ROW.min_normal_force, i])
                demand[w] = max(demand[w], out[ROW.friction_demand, i])
                impulse[w] = max(impulse[w], out[ROW.impulse_friction_demand, i])
                clearance[w] = min(clearance[w], out[ROW.clearance, i])
    fallen[wheel[:count]] = False
    return fallen, energy, distance, force, demand, impulse, clearance  # the last as in `Extremes`
