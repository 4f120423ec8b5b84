"""Bound the least cost of transport of any gait at any speed from below, by a storage function.

docs/bounds.md has the argument and the results. A linear program chooses the storage function so
that an inequality holds at sampled states; fresh samples then measure by how much it is violated
between them, and the bound is lowered by that. It takes some ten minutes of one core.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from rimless_gym import BUILDABLE
from rimless_gym.equations import DOUBLE, SINGLE, equations
from scripts.studies.documents.markdown import formatted, marks, refresh
from trajopt.gaits.fronts import shipped_front
from trajopt.gaits.problem import MIN_NORMAL_FORCE
from trajopt.ocp.arrays import Array

PARAMS = BUILDABLE
C, V, WEIGHT = PARAMS.constants, PARAMS.voltage_limit, PARAMS.weight

#: The region of the states: rates (rad/s) and mechanical energy (J). The best gait stays within
#: 0 to 7 and -25 to -10 rad/s and below 12.3 J.
DPHI, DTHETA, ENERGY = (-4.0, 8.0), (-30.0, 30.0), 14.0

#: States sampled per coefficient at first, and afresh in a round; those that are kept of a round;
#: rounds of the last measurement.
SAMPLES, FRESH, WORST, LAST = 20, 60_000, 600, 8

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
    "δ (J)": "{fall:.1e}",
    "bound left": "{cot:.5f}",
}

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)


class StorageBound(NamedTuple):
    """A storage function's bound."""

    cot: float  # the bound with the violations added
    sampled: float  # the linear program's bound, at its samples
    scale: float  # by which storage function and bound are scaled, to hold at all states found
    fall: float  # most that the storage function falls in a jump (J)


def bounds(*, degree: int = 5, rounds: int = 40, docs: Path | None = None) -> int:
    """Bound the least cost of transport of BUILDABLE at any speed.

    Args:
        degree: total degree of the storage function.
        rounds: of adding samples where the inequality is violated.
        docs: docs/bounds.md, to write the table into.
    """
    basis = Basis(degree)
    found = best_certificate(basis, rounds, np.random.default_rng(degree))
    row = {"degree": degree, "rounds": rounds, "coefficients": len(basis.powers)}
    text = formatted(COLUMNS, [row | found._asdict()]) + "\n"
    if docs:
        refresh(docs, marks("bounds", ("storage",)), {"storage": text})
    print(text)
    return 0


def best_certificate(basis: Basis, rounds: int, rng: np.random.Generator) -> StorageBound:
    """The bound after some rounds of adding samples where the inequality is violated."""
    flow = [_flow_rows(basis, m, x, u) for m, x, u in _first_samples(basis, rng)]
    flow += [_flow_rows(basis, SINGLE, x, u) for x, u in _gaits()]
    jumps = [basis.values(y) - basis.values(x) for x, y in _jumps(20 * len(basis.powers), rng)]
    worst: dict[int, Array] = dict.fromkeys((SINGLE, DOUBLE), np.empty((4, 0)))
    for done in range(rounds):
        z, cot = least_cot(np.concatenate(flow), np.concatenate(jumps))
        for mode, near in worst.items():
            x, u, margin = _worst(basis, mode, z, cot, near, rng)
            bad = margin < 0
            worst[mode] = x[:, np.argsort(margin)[:WORST]]
            flow.append(_flow_rows(basis, mode, x[:, bad], u[bad]))
            print(f"round {done}: c = {cot:.5f}, least margin {margin.min():.4f}", flush=True)
        for x, y in _jumps(FRESH, rng):
            gain = basis.values(y) - basis.values(x)
            least = np.argsort(gain @ z)[:WORST]
            jumps.append(gain[least[(gain[least] @ z) < 0]])
    return certified(basis, z, cot, worst, rng)


def certified(
    basis: Basis, z: Array, cot: float, worst: dict[int, Array], rng: np.random.Generator
) -> StorageBound:
    """The bound that fresh samples leave of a storage function, and a search around the worst."""
    scale, jump = 1.0, 0.0
    for _ in range(LAST):
        for mode, near in worst.items():
            x, _, margin = _worst(basis, mode, scale * z, scale * cot, near, rng)
            worst[mode] = x[:, np.argsort(margin)[:WORST]]
            scale /= 1.0 - min(0.0, float(margin.min()))
        gains = [(basis.values(y) - basis.values(x)) @ z for x, y in _jumps(FRESH, rng)]
        jump = float(np.concatenate([[jump], *gains]).min())
    return StorageBound(scale * (cot + jump / (WEIGHT * C.chord)), cot, scale, -jump)


def _worst(
    basis: Basis, mode: int, z: Array, cot: float, near: Array, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Fresh states, and states ever nearer to the worst ones, with their voltage of `least_margin`.

    The margins are given as shares of the power.
    """
    found = []
    x = np.concatenate([_states(mode, FRESH, rng), _near(near, 0.03, rng)], axis=1)
    for spread in (0.03, 0.01, 0.003):
        u, margin = least_margin(basis, mode, x, z, cot)
        margin /= _power(x, u)
        least = np.argsort(margin)[:WORST]
        found.append((x[:, least], u[least], margin[least]))
        x = _near(x[:, least], spread, rng)
    return tuple(np.concatenate(each, axis=-1) for each in zip(*found, strict=True))  # type: ignore[return-value]


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
        at_left, at_right = _limits(mode, x, left), _limits(mode, x, right)
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
    """Random states within the region, (4, `count` or fewer)."""
    low, high = np.array([(C.a, C.b), (-math.pi, math.pi), DPHI, DTHETA]).T
    x = rng.uniform(low, high, (count, 4)).T
    if mode == DOUBLE:
        x[0], x[2] = C.a, 0.0
    return _inside(x)


def _near(x: Array, spread: float, rng: np.random.Generator) -> Array:
    """These states, and nine near each of them, by a share of the region's size."""
    size = np.array([C.alpha, 2 * math.pi, DPHI[1] - DPHI[0], DTHETA[1] - DTHETA[0]])
    if len(x.T) and np.all(x[2] == 0):  # double stance
        size[[0, 2]] = 0.0
    x = np.repeat(x, 10, axis=1)
    away = rng.normal(size=x.shape)
    away[:, ::10] = 0.0
    return _inside(x + spread * size[:, None] * away)


def _inside(x: Array) -> Array:
    inside = _eq.mechanical_energy(*x, C) <= ENERGY
    for row, (low, high) in zip((0, 2, 3), ((C.a, C.b), DPHI, DTHETA), strict=True):
        inside &= (x[row] >= low) & (x[row] <= high)
    return x[:, inside]


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
        x = _inside(x)
        y = np.array(touchdown(*x, C))
        stop = np.zeros_like(x)
        stop[0], stop[1], stop[3] = C.a, x[1], _eq.stop_on_two_feet(*x, C)
        impulse = np.subtract(_eq.linear_momentum(*y, C), _eq.linear_momentum(*x, C))
        steps = (sign * y[2] > 0) & (np.abs(impulse[0]) <= PARAMS.friction * impulse[1])
        stops = sign * y[2] <= 0
        yield x[:, steps], y[:, steps]
        yield x[:, stops], stop[:, stops]


# -- the storage function and the linear program ---------------------------------------------------


class Basis:
    """Functions of the state up to a total degree: powers of phi, phi', theta', waves in theta.

    Standing on either foot at rest is the same state, so phi is not odd where phi' is absent.
    """

    def __init__(self, degree: int) -> None:
        d = range(degree + 1)
        self.degree = degree
        self.powers = np.array(
            [
                (p, wave, q, r)
                for p in d
                for q in d
                for r in d
                for m in d
                for wave in ((2 * m - 1, 2 * m) if m else (0,))
                if 0 < p + q + r + m <= degree and (q or p % 2 == 0)
            ]
        )

    def values(self, x: Array) -> Array:
        """The functions at states (4, N), (N, n)."""
        phi, theta, dphi, dtheta = (values for values, _ in self._factors(x))
        return phi * theta * dphi * dtheta

    def gradients(self, x: Array) -> Iterator[Array]:
        """Their derivatives by phi, theta, phi', theta', each (N, n)."""
        (phi, d_phi), (theta, d_theta), (dphi, d_dphi), (dtheta, d_dtheta) = self._factors(x)
        rates, angles = dphi * dtheta, phi * theta
        yield rates * theta * d_phi
        yield rates * phi * d_theta
        yield angles * dtheta * d_dphi
        yield angles * dphi * d_dtheta

    def _factors(self, x: Array) -> list[tuple[Array, Array]]:
        """What each function has of phi, theta, phi', theta', and its derivative, (N, n) each."""
        phi, theta, dphi, dtheta = x
        factors = (
            self._polynomials(phi - math.pi / 2, C.alpha / 2),
            self._waves(theta),
            self._polynomials(dphi, DPHI[1]),
            self._polynomials(dtheta, DTHETA[1]),
        )
        return [(f[:, k], d[:, k]) for (f, d), k in zip(factors, self.powers.T, strict=True)]

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


def least_cot(flow: Array, jumps: Array) -> tuple[Array, float]:
    """The storage function's n coefficients and the greatest bound at the samples.

    `flow` are rows of `_flow_rows`; `jumps`, (rows, n), the gains of the basis in jumps.
    """
    n = jumps.shape[1]
    box = np.eye(n + 1)[:-1]
    a = np.concatenate([-flow[:, :-1], np.column_stack([-jumps, 0 * jumps[:, 0]]), box, -box])
    b = np.concatenate([flow[:, -1], np.zeros(len(jumps)), np.full(2 * n, LARGEST)])
    size = 1 / np.maximum(np.linalg.norm(a, axis=1), 1e-3)
    y = interior_point(a * size[:, None], b * size, -np.eye(n + 1)[-1])
    return y[:-1], float(y[-1])


def interior_point(a: Array, b: Array, cost: Array) -> Array:
    """y of least cost . y with a y <= b, within `GAP`, by Mehrotra's predictor and corrector.

    SciPy's HiGHS takes minutes where this takes seconds, because these rows are dense.
    """
    y, slack, weight = np.zeros(len(cost)), np.ones(len(b)), np.ones(len(b)) / len(b)
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
