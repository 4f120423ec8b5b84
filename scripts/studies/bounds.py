"""Bound the least cost of transport of any gait at any speed from below, by a storage function.

docs/bounds.md has the argument and the results. A linear program chooses the storage function so
that an inequality holds at sampled states; fresh samples then measure by how much it is violated
between them, and the bound is lowered by that. It takes some six minutes of one core.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from agents.cli.options import Count, MaybePath, Several
from rimless_gym import BUILDABLE
from rimless_gym.equations import DOUBLE, SINGLE, equations
from scripts.studies.documents.markdown import formatted, marks, refresh
from trajopt.gaits.fronts import shipped_front
from trajopt.gaits.problem import MIN_NORMAL_FORCE
from trajopt.ocp.arrays import Array, Indices

PARAMS = BUILDABLE
C, V, WEIGHT = PARAMS.constants, PARAMS.voltage_limit, PARAMS.weight

#: The region of the states: rates (rad/s) and mechanical energy (J). The best gait stays within
#: 0 to 7 and -25 to -10 rad/s and below 12.3 J.
REGION, ENERGY = np.array([(C.a, C.b), (-math.pi, math.pi), (-4.0, 8.0), (-30.0, 30.0)]), 14.0

#: States sampled per coefficient at first, and afresh in a round; by how much of its size they are
#: drawn beyond the region, and brought to its border; rounds of the last measurement.
SAMPLES, FRESH, BEYOND, LAST = 20, 40_000, 0.15, 8

#: Limits of the voltage are widened by this (N; rad/s^2 on two feet): the voltage at which one is
#: reached is interpolated, and limits are only nearly linear.
RELAXED = 0.1

#: The region's cells. The worst state of a cell counts if its margin is below `NEARLY`, in at most
#: `WORST` cells; it is moved to the worst of `NEAR` states near it, ever nearer (in sizes of the
#: region).
CELLS, NEARLY, WORST, NEAR, SPREADS = (6, 12, 8, 14), 0.02, 600, 8, (0.05, 0.02, 0.01, 0.004)

#: After `FIRST` rounds, a round's storage function moves this share of the way to the new optimum.
FIRST, SHARE = 6, 0.3

#: In a sampled jump the storage function rises by at least this share of the change of its basis,
#: so that it falls in none between the samples.
RISE = 6e-4

#: The linear program ends this far from its optimum (relative): inside of what it admits, fewer
#: inequalities are violated between the samples. No coefficient exceeds `LARGEST` (J).
GAP, LARGEST = 0.03, 30.0

#: Columns of the table: heading and format.
COLUMNS = {
    "degree": "{degree}",
    "rounds": "{rounds}",
    "coefficients": "{coefficients}",
    "c at the samples": "{sampled:.5f}",
    "s": "{scale:.4f}",
    "least rise": "{rise:.1e}",
    "bound left": "{cot:.5f}",
}

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)


class StorageBound(NamedTuple):
    """A storage function's bound."""

    cot: float  # the bound with the violations added
    sampled: float  # the linear program's bound, at its samples
    scale: float  # by which storage function and bound are scaled, to hold at all states found
    rise: float  # least that the storage function rises in a jump, over the change of its basis


def bounds(*, degrees: Several = ("5",), rounds: Count = 36, docs: MaybePath = None) -> int:
    """Bound the least cost of transport of BUILDABLE at any speed.

    Args:
        degrees: total degrees of the storage function.
        rounds: of adding samples where the inequality is violated.
        docs: docs/bounds.md, to write the table into.
    """
    rows = []
    for degree in map(int, degrees):
        basis = Basis(degree)
        found = best_certificate(basis, rounds, np.random.default_rng(degree))
        size = {"degree": degree, "rounds": rounds, "coefficients": len(basis.powers)}
        rows.append(size | found._asdict())
    text = formatted(COLUMNS, rows) + "\n"
    if docs:
        refresh(docs, marks("bounds", ("storage",)), {"storage": text})
    print(text)
    return 0


def best_certificate(basis: Basis, rounds: int, rng: np.random.Generator) -> StorageBound:
    """The bound after some rounds of adding samples where the inequality is violated.

    The optimum jumps from round to round, and is violated elsewhere each time. So violations are
    sought of a mean of the optima so far, in which the last ones weigh most.
    """
    flow = [_flow_rows(basis, m, x, u) for m, x, u in _first_samples(basis, rng)]
    flow += [_flow_rows(basis, SINGLE, x, u) for x, u in _gaits()]
    jumps = list(_rises(basis, 40 * len(basis.powers), rng))
    violated: dict[int, Array] = dict.fromkeys((SINGLE, DOUBLE), np.empty((4, 0)))
    mean = np.zeros(len(basis.powers) + 1)
    for done in range(rounds):
        best = least_cot(np.concatenate(flow), np.concatenate(jumps))
        mean = best if done < FIRST else mean + SHARE * (best - mean)
        z, cot = mean[:-1], float(mean[-1])
        for mode in violated:
            x, u, margin = _worst(basis, mode, z, cot, violated[mode], rng)
            x, u = x[:, margin < 0], u[margin < 0]
            violated[mode] = np.concatenate([violated[mode], x], axis=1)
            flow += [_flow_rows(basis, mode, x, u), *_at_ends(basis, mode, x)]
            print(
                f"round {done}: c = {cot:.5f}, least margin {margin.min(initial=0):.4f}", flush=True
            )
        for rises in _rises(basis, FRESH, rng):
            least = np.argsort(rises @ z)[:WORST]
            jumps.append(rises[least[(rises[least] @ z) < RISE]])
    return certified(basis, z, cot, violated, rng)


def certified(
    basis: Basis, z: Array, cot: float, violated: dict[int, Array], rng: np.random.Generator
) -> StorageBound:
    """The bound that fresh samples leave of a storage function, and a search around the worst."""
    scale, least = 1.0, math.inf
    for _ in range(LAST):
        for mode, known in violated.items():
            x, _, margin = _worst(basis, mode, scale * z, scale * cot, known, rng)
            violated[mode] = np.concatenate([known, x[:, margin < 0]], axis=1)
            scale /= 1.0 - min(0.0, float(margin.min(initial=0.0)))
        least = min(least, *(float((rises @ z).min()) for rises in _rises(basis, FRESH, rng)))
    return StorageBound(scale * cot if least >= 0.0 else 0.0, cot, scale, least)


def _worst(
    basis: Basis, mode: int, z: Array, cot: float, known: Array, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """The worst states of all cells, with their voltages and margins as shares of the power.

    They are found among fresh and known states, and then near the worst of each cell.
    """
    x = np.concatenate([_states(mode, FRESH, rng), known], axis=1)
    u, margin = _shares(basis, mode, x, z, cot)
    least = _least_of_cells(x, margin)
    x, u, margin = x[:, least], u[least], margin[least]
    for spread in SPREADS:
        x = _near(mode, x, spread, rng)
        u, margin = _shares(basis, mode, x, z, cot)
        least = margin.reshape(-1, NEAR).argmin(axis=1) + NEAR * np.arange(len(margin) // NEAR)
        x, u, margin = x[:, least], u[least], margin[least]
    return x, u, margin


def _shares(basis: Basis, mode: int, x: Array, z: Array, cot: float) -> tuple[Array, Array]:
    u, margin = least_margin(basis, mode, x, z, cot)
    return u, margin / _power(x, u)


def _least_of_cells(x: Array, margin: Array) -> Indices:
    """The index of the state of least margin in every cell, where it is below `NEARLY`."""
    low, high = REGION.T[:, :, None]
    place = np.floor((x - low) / (high - low) * np.array(CELLS)[:, None]).astype(int)
    cell = np.ravel_multi_index(tuple(place), CELLS, mode=("clip", "wrap", "clip", "clip"))
    order = np.argsort(margin)
    _, first = np.unique(cell[order], return_index=True)
    least = order[np.sort(first)]
    return least[margin[least] < NEARLY][:WORST]


# -- the inequality --------------------------------------------------------------------------------


def _accelerations(mode: int, x: Array, u: Array) -> tuple[Array, Array]:
    if mode == SINGLE:
        return _eq.single_stance(*x, u, C)
    return np.zeros_like(u), _eq.double_stance(*x, u, C)


def _limits(mode: int, x: Array, u: Array) -> Array:
    """What must not be negative, nearly linear in u on either side of coasting, (3, N)."""
    if mode == DOUBLE:
        leading, trailing = _eq.lift_off_guards(x[1], x[3], u, C)
        return np.array([-leading, trailing, trailing])
    fx, fy = _eq.ground_reaction(*x, *_accelerations(mode, x, u), C)
    cone = PARAMS.friction * fy
    return np.array([fy - MIN_NORMAL_FORCE * WEIGHT, cone - fx, cone + fx])


def _power(x: Array, u: Array) -> Array:
    rate = _eq.relative_rate(x[2], x[3], C)
    return np.maximum(_eq.electrical_power(rate, u, C), 0.0) + PARAMS.idle_power


def _speed(x: Array) -> Array:
    """Forward speed of the hub (m/s), the rate of the model's `hub_position`."""
    return C.L1 * x[2] * np.sin(x[0])


def _flow_rows(basis: Basis, mode: int, x: Array, u: Array) -> Array:
    """Rows (rates of the basis, -W times speed, power), with row . (z, c, 1) >= 0 to hold."""
    rates = (x[2], x[3], *_accelerations(mode, x, u))
    change = sum(g * rate[:, None] for g, rate in zip(basis.gradients(x), rates, strict=True))
    return np.column_stack([change, -WEIGHT * _speed(x), _power(x, u)])


def _at_ends(basis: Basis, mode: int, x: Array) -> Iterator[Array]:
    """Rows at these states for the voltages at the ends of what is admissible, and coasting."""
    voltages = list(_voltages(mode, x, np.zeros_like))
    for u, admissible in (*voltages[:1], *voltages[1::3]):
        yield _flow_rows(basis, mode, x[:, admissible], u[admissible])


def least_margin(basis: Basis, mode: int, x: Array, z: Array, cot: float) -> tuple[Array, Array]:
    """Of each state the admissible voltage of least margin (W) in the inequality, and the margin.

    It is infinite where no voltage is admissible.
    """
    gradient = np.array([g @ z for g in basis.gradients(x)])

    def storage_rate(u: Array) -> Array:
        ddphi, ddtheta = _accelerations(mode, x, u)
        return gradient[0] * x[2] + gradient[1] * x[3] + gradient[2] * ddphi + gradient[3] * ddtheta

    worst, least = np.zeros(x.shape[1]), np.full(x.shape[1], math.inf)
    for u, admissible in _voltages(mode, x, storage_rate):
        margin = _power(x, u) + storage_rate(u) - cot * WEIGHT * _speed(x)
        better = admissible & (margin < least)
        worst, least = np.where(better, u, worst), np.where(better, margin, least)
    return worst, least


def _voltages(
    mode: int, x: Array, storage_rate: Callable[[Array], Array]
) -> Iterator[tuple[Array, Any]]:
    """Voltages of which one minimises power + storage rate, and whether each is admissible.

    Between the limit, 0 and coasting, E+ is quadratic or 0, storage rate and limits are linear: the
    least is at an end of what is admissible or where the derivative is 0.
    """
    coasting = _eq.motor_voltage(_eq.relative_rate(x[2], x[3], C), 0.0, C)
    limit = np.full_like(coasting, V)
    ends = np.sort([-limit, 0 * limit, np.clip(coasting, -V, V), limit], axis=0)
    for left, right in pairwise(ends):
        width = np.maximum(right - left, 1e-9)
        at_left, at_right = (_limits(mode, x, u) + RELAXED for u in (left, right))
        with np.errstate(divide="ignore", invalid="ignore"):
            roots = left + width * at_left / (at_left - at_right)
        low = np.where((at_left < 0) & (at_right > 0), roots, left).max(axis=0)
        high = np.where((at_left > 0) & (at_right < 0), roots, right).min(axis=0)
        admissible = (low <= high) & ~((at_left < 0) & (at_right < 0)).any(axis=0)
        slope = (storage_rate(right) - storage_rate(left)) / width
        flat = (coasting - slope * C.Rm) / 2
        for u in (low, high, np.clip(flat, low, high)):
            yield np.where(admissible, u, left), admissible


# -- samples ---------------------------------------------------------------------------------------


def _states(mode: int, count: int, rng: np.random.Generator) -> Array:
    """Random states of the region and of its border, where violations are largest, (4, `count`)."""
    low, high = REGION.T
    beyond = BEYOND * (high - low)
    return _within(mode, rng.uniform(low - beyond, high + beyond, (count, 4)).T)


def _near(mode: int, x: Array, spread: float, rng: np.random.Generator) -> Array:
    """Each state, and others near it, `NEAR` in a row."""
    low, high = REGION.T
    x = np.repeat(x, NEAR, axis=1)
    away = rng.normal(size=x.shape)
    away[:, ::NEAR] = 0.0
    return _within(mode, x + spread * (high - low)[:, None] * away)


def _within(mode: int, x: Array) -> Array:
    """The states, brought into the region: clipped, and slowed down to its energy."""
    low, high = REGION.T[:, :, None]
    phi, theta, dphi, dtheta = np.where([[False], [True], [False], [False]], x, x.clip(low, high))
    if mode == DOUBLE:
        phi, dphi = np.full_like(phi, C.a), np.zeros_like(dphi)
    potential = _eq.mechanical_energy(phi, theta, 0 * dphi, 0 * dtheta, C)
    kinetic = _eq.mechanical_energy(phi, theta, dphi, dtheta, C) - potential
    slower = np.sqrt(np.minimum(1.0, (ENERGY - potential) / np.maximum(kinetic, 1e-9)))
    return np.array([phi, theta, slower * dphi, slower * dtheta])


def _first_samples(basis: Basis, rng: np.random.Generator) -> Iterator[tuple[int, Array, Array]]:
    for mode in (SINGLE, DOUBLE):
        x = _states(mode, SAMPLES * len(basis.powers), rng)
        for u, admissible in list(_voltages(mode, x, np.zeros_like))[::2]:
            some = admissible & (rng.random(len(u)) < 0.25)
            yield mode, x[:, some], u[some]


def _gaits() -> Iterator[tuple[Array, Array]]:
    """States and voltages of gaits on the front: where the inequality is tight, or nearly so."""
    for gait in shipped_front(PARAMS).envelope:
        t = np.linspace(0.0, gait.duration, 101)[1:-1]
        yield gait.state(t).T, np.asarray(gait.control(t))


def _jumps(count: int, rng: np.random.Generator) -> Iterator[tuple[Array, Array]]:
    """States before and after touchdowns, forward and backward, with a step or a stop."""
    for sign, phi, touchdown in ((1, C.b, _eq.touchdown), (-1, C.a, _eq.touchdown_backward)):
        x = _states(SINGLE, count // 2, rng)
        x[0], x[2] = phi, sign * np.abs(x[2]) * rng.random(x.shape[1])
        x = _within(SINGLE, x)
        y = np.array(touchdown(*x, C))
        stop = np.zeros_like(x)
        stop[0], stop[1], stop[3] = C.a, x[1], _eq.stop_on_two_feet(*x, C)
        impulse = np.subtract(_eq.linear_momentum(*y, C), _eq.linear_momentum(*x, C))
        steps = (sign * y[2] > 0) & (np.abs(impulse[0]) <= PARAMS.friction * impulse[1])
        stops = sign * y[2] <= 0
        yield x[:, steps], y[:, steps]
        yield x[:, stops], stop[:, stops]


def _rises(basis: Basis, count: int, rng: np.random.Generator) -> Iterator[Array]:
    """Changes of the basis in jumps, each of length 1: the storage function must rise in them."""
    for x, y in _jumps(count, rng):
        if x.size:
            change = basis.values(y) - basis.values(x)
            yield change / np.maximum(np.linalg.norm(change, axis=1, keepdims=True), 1e-9)


# -- the storage function and the linear program ---------------------------------------------------


class Basis:
    """Functions of the state up to a total degree: powers of phi, phi', theta', waves in theta.

    They are multiplied by powers of the mechanical energy, each of degree 2: it is the storage
    function of a machine without losses, and a polynomial comes near to it only. Standing on either
    foot at rest is the same state, so phi is not odd where phi' is absent.
    """

    def __init__(self, degree: int) -> None:
        d = range(degree + 1)
        self.degree = degree
        self.powers = np.array(
            [
                (p, wave, q, r, e)
                for p in d
                for q in d
                for r in d
                for e in d
                for m in d
                for wave in ((2 * m - 1, 2 * m) if m else (0,))
                if 0 < p + q + r + m + 2 * e <= degree and (q or p % 2 == 0)
            ]
        )

    def values(self, x: Array) -> Array:
        """The functions at states (4, N), (N, n)."""
        phi, theta, dphi, dtheta, energy = (values for values, _ in self._factors(x))
        return phi * theta * dphi * dtheta * energy

    def gradients(self, x: Array) -> Iterator[Array]:
        """Their derivatives by phi, theta, phi', theta', each (N, n)."""
        factors = self._factors(x)
        (phi, d_phi), (theta, d_theta), (dphi, d_dphi), (dtheta, d_dtheta), (e, d_e) = factors
        rates, angles = dphi * dtheta, phi * theta
        others, rates_e, angles_e = angles * rates * d_e, rates * e, angles * e
        by_phi, by_theta, by_dphi, by_dtheta = self._energy_slopes(x)
        yield rates_e * theta * d_phi + others * by_phi
        yield rates_e * phi * d_theta + others * by_theta
        yield angles_e * dtheta * d_dphi + others * by_dphi
        yield angles_e * dphi * d_dtheta + others * by_dtheta

    def _factors(self, x: Array) -> list[tuple[Array, Array]]:
        """What each function has of phi, theta, phi', theta', E, and its derivative, (N, n)."""
        phi, theta, dphi, dtheta = x
        factors = (
            self._polynomials(phi - math.pi / 2, C.alpha / 2),
            self._waves(theta),
            self._polynomials(dphi, REGION[2, 1]),
            self._polynomials(dtheta, REGION[3, 1]),
            self._polynomials(_eq.mechanical_energy(*x, C), ENERGY),
        )
        return [(f[:, k], d[:, k]) for (f, d), k in zip(factors, self.powers.T, strict=True)]

    def _energy_slopes(self, x: Array) -> list[Array]:
        """The energy's derivatives by phi, theta, phi', theta', (N, 1): by complex steps."""
        steps = 1e-30j * np.eye(4)[:, :, None]
        return [_eq.mechanical_energy(*(x + step), C).imag[:, None] / 1e-30 for step in steps]

    def _polynomials(self, x: Array, size: float) -> tuple[Array, Array]:
        power = np.arange(self.degree + 1)
        values = (x[:, None] / size) ** power
        slopes = np.column_stack([0 * x, values[:, :-1]]) * power / size
        return values, slopes

    def _waves(self, x: Array) -> tuple[Array, Array]:
        m = np.arange(1, self.degree + 1)
        sines, cosines = np.sin(m * x[:, None]), np.cos(m * x[:, None])
        values = np.stack([sines, cosines], axis=2).reshape(len(x), 2 * self.degree)
        slopes = np.stack([m * cosines, -m * sines], axis=2).reshape(len(x), 2 * self.degree)
        return np.column_stack([0 * x + 1, values]), np.column_stack([0 * x, slopes])


def least_cot(flow: Array, jumps: Array) -> Array:
    """The storage function's n coefficients, and the greatest bound at the samples, (n + 1,).

    `flow` are rows of `_flow_rows`; `jumps`, (rows, n), those of `_rises`.
    """
    box = np.eye(jumps.shape[1] + 1)[:-1] / LARGEST
    rises = np.column_stack([jumps, np.zeros(len(jumps))])
    a = np.concatenate([-flow[:, :-1] / flow[:, -1:], box, -box, -rises])
    b = np.repeat([1.0, -RISE], [len(a) - len(rises), len(rises)])
    return interior_point(a, b, -np.eye(len(box) + 1)[-1])


def interior_point(a: Array, b: Array, cost: Array) -> Array:
    """y of least cost . y with a y <= b, within `GAP`, by Mehrotra's predictor and corrector.

    SciPy's HiGHS takes minutes where this takes seconds, because these rows are dense.
    """
    y, slack = np.zeros(len(cost)), np.maximum(b, 0.1)
    weight = 1 / (slack * len(b))
    while True:
        primal, dual, gap = a @ y + slack - b, a.T @ weight + cost, slack @ weight
        if gap < GAP * abs(cost @ y) and np.abs(primal).max() < 1e-6:
            return y
        normal = (a * (weight / slack)[:, None]).T @ a
        normal[np.diag_indices_from(normal)] += 1e-12 * np.trace(normal) / len(y)
        factors = cho_factor(normal)
        target, forward, backward = -slack * weight, 0.0, 0.0
        ds = dw = np.zeros_like(slack)
        for centring in (False, True):
            if centring:
                after = (slack + forward * ds) @ (weight + backward * dw)
                target = target + (after / gap) ** 3 * gap / len(b) - ds * dw
            dy = cho_solve(factors, -dual - a.T @ ((target + weight * primal) / slack))
            ds = -primal - a @ dy
            dw = (target - weight * ds) / slack
            forward, backward = _longest(slack, ds), _longest(weight, dw)
        y, slack, weight = y + forward * dy, slack + forward * ds, weight + backward * dw


def _longest(of: Array, change: Array) -> float:
    """The longest step of at most 1 along a change that keeps everything positive."""
    falls = change < 0
    return 0.995 * float(np.min(-of[falls] / change[falls], initial=1 / 0.995))
