"""Parameters of a machine by least squares over pieces of a log (multiple shooting).

Within a piece the wheel stands on one foot, or rests on two. Its motion is integrated from an
unknown state at the piece's start, under the logged voltage, and compared with every sample. The
derivatives by that state and by the parameters are CasADi's, of the model that everything else
uses (`rimless_gym.symbolic`). The states are eliminated piece by piece (Bock, Recent Advances in
Parameter Identification Techniques for ODE, 1983), first of short pieces, which converge from
afar, then of stances, which hold more information. The log of a wheel that falls counts until
then.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import positive, real_array, require_kind
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE, Machine, as_params
from rimless_gym.symbolic import Design, HybridModel
from trajopt.feedback.law import Floats
from trajopt.identification.log import Log, LogError, require_usable

#: What is uncertain of a machine that was weighed and measured. The gear's teeth can be counted.
PHYSICAL = (
    *("wheel_mass", "wheel_inertia", "leg_length"),
    *("pendulum_mass", "pendulum_inertia", "pendulum_length"),
    *("motor_constant", "armature_resistance", "rotor_inertia"),
    *("hub_friction", "gear_loss"),
)

#: How well parameters are known before: their standard deviation, as a share; and that of those
#: which are usually 0 (rad, N m s).
TOLERANCE, TOLERANCES = 0.05, {"slope": 0.05, "hub_damping": 2e-3}

#: Longest pieces of both passes (s), and the fewest samples of one.
PASSES, FEWEST = (0.2, 0.8), 4

#: Integration steps within a sample, of Runge and Kutta's fourth order, are at most so long (s):
#: with half of it, estimates differ by a fiftieth of their standard deviation. They are shorter
#: where the motor damps the pendulum faster than that.
STEP = 0.01

#: A leg may have touched down between two samples if it was nearer than what it moves from one to
#: the next and so many standard deviations of its error.
SHORT_OF = 5.0

#: Gauss-Newton steps per pass, halvings of one, and the step, in tolerances, at which it ends.
STEPS, HALVINGS, SMALL = 15, 6, 1e-3

#: Standard deviations of a piece's first rates and angles (rad/s, rad): they are not known.
FREE_START = np.array([10.0, 10.0, 100.0, 100.0])

#: A piece whose squares per degree of freedom are so many times their median is left out.
OUTLIER = 10.0

#: A fit with a larger chi2 per degree of freedom is of another machine, or went wrong.
MOST_CHI2 = 3.0

#: One below this is of errors that are far smaller than those given.
SMALL_CHI2 = 0.1

#: A direction of which the log holds less information than this, per squared tolerance, is not
#: identifiable.
LEAST_INFORMATION = 1.0

#: A log shows little of a parameter whose deviation is still more than this share of that before.
LITTLE = 0.5

#: Most that a parameter may change, in its tolerances, where these are a share of it.
FARTHEST = 8.0


@dataclasses.dataclass(frozen=True)
class Noise:
    """Standard deviations of the sensors' errors.

    Attributes:
        angle: of both angles (rad).
        current: A.
        rate: of both rates (rad/s).
    """

    angle: float = 1e-3
    current: float = 5e-3
    rate: float = 1e-2

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            object.__setattr__(self, name, positive(name, value))


@dataclasses.dataclass(frozen=True)
class Identification:
    """A machine as a log shows it.

    Attributes:
        params: the identified machine.
        nominal: what was known before.
        free: names of the identified parameters, k of them.
        tolerance: their standard deviations before, shape (k,).
        covariance: of the estimates, shape (k, k); where chi2 is above 1, what the log shows counts
            1 / chi2 as much, and what was known before in full.
        unidentifiable: directions of which the log has no information, each by its share of every
            parameter, in tolerances; what was known before stands in them.
        residuals: root mean square by channel, in standard deviations of its noise.
        chi2: sum of squared residuals per degree of freedom; about 1 for the right machine.
        samples: how many values were compared.
        left_out: share of the values in pieces that fit far worse than the others (`OUTLIER`), and
            so were not.
    """

    params: WheelParams
    nominal: WheelParams
    free: tuple[str, ...]
    tolerance: Floats
    covariance: Floats
    unidentifiable: tuple[Mapping[str, float], ...]
    residuals: Mapping[str, float]
    chi2: float
    samples: int
    left_out: float

    @property
    def values(self) -> Floats:
        """The estimates, shape (k,)."""
        return np.array([getattr(self.params, name) for name in self.free])

    def report(self) -> str:
        """A table of the estimates, and what else there is to know."""
        lines = [f"{'parameter':20}{'before':>12}{'identified':>12}{'± 1 sd':>10}{'change':>9}"]
        after = np.sqrt(np.diag(self.covariance))
        for name, value, sd, known in zip(
            self.free, self.values, after, self.tolerance, strict=True
        ):
            before = getattr(self.nominal, name)
            change = f"{value / before - 1:+9.2%}" if before else f"{'':9}"
            little = "  little in the log" if sd > LITTLE * known else ""
            lines.append(f"{name:20}{before:12.5g}{value:12.5g}{sd:10.2g}{change}{little}")
        lines.append(
            f"chi2 per degree of freedom {self.chi2:.3g}, {self.samples} values"
            + (f", {self.left_out:.0%} left out" if self.left_out else "")
        )
        if self.chi2 < SMALL_CHI2:
            lines.append(f"the errors given are {self.chi2**-0.5:.0f} times those of the log")
        lines += [f"residual of {c}: {r:.2f} sd" for c, r in self.residuals.items()]
        for each in self.unidentifiable:
            parts = [f"{share:+.2f} {name}" for name, share in each.items()]
            lines.append(f"not identifiable, in deviations known before: {', '.join(parts)}")
        return "\n".join(lines)


def identify(
    log: Log,
    params: Machine = "BUILDABLE",
    free: Sequence[str] | None = None,
    *,
    tolerance: float | Mapping[str, float] = TOLERANCE,
    covariance: Floats | None = None,
    noise: Noise | None = None,
) -> Identification:
    """The parameters that explain a log best, near those known before.

    What an earlier log showed is known too, if its `covariance` is given, and its machine as
    `params`.

    Args:
        log: of angles, voltage, stance foot and mode, with or without current and rates.
        params: what is known before.
        free: names of the unknown parameters, numbers of `WheelParams`; by default `physical`.
        tolerance: how well these are known: a standard deviation as a share of each, or by name, in
            its unit; those not named are `TOLERANCE` of their value, or as in `TOLERANCES`.
        covariance: of all that is known before, (k, k), instead of `tolerance`.
        noise: of the sensors.

    Raises:
        LogError: the log is too short, too still, in other units or of another machine.
        TypeError, ValueError: another argument is of the wrong type or out of its range.
    """
    params, noise = as_params(params), noise or Noise()
    require_kind("noise", noise, Noise)
    require_usable(log, params)
    free = physical(params) if free is None else tuple(free)
    if covariance is None:
        before = np.diag(tolerances(params, free, tolerance) ** 2)
    else:
        _require_motion(params, free)
        before = _covariance(covariance, len(free))
    scale = np.sqrt(np.diag(before))
    prior = np.linalg.inv(before / np.outer(scale, scale))
    channels = [name for name in ("phi", "theta", "current", "dphi", "dtheta") if _has(log, name)]
    fit = _Fit(log, params, free, scale, prior, tuple(channels), noise)
    starts: dict[int, Floats] = {}
    q = np.zeros(len(free))
    with np.errstate(over="ignore", invalid="ignore"):  # what diverges is refused below
        for longest in PASSES:
            pieces = fit.pieces(longest, starts)
            q, pieces, system = fit.solved(pieces, q)
            compared = system.compared
            for _ in range(len(pieces.begins) // FEWEST):
                if (kept := fit.without_worst(pieces, system)) is None:
                    break
                q, pieces, system = fit.solved(kept, q)
            starts = dict(zip(pieces.begins.tolist(), pieces.states, strict=True))
    degrees = max(system.compared - 4 * len(pieces.begins) - len(free), 1)
    chi2 = system.squares / degrees
    residuals = {name: float(r) for name, r in zip(channels, system.rms, strict=True)}
    if not chi2 < MOST_CHI2:
        worst = max(residuals, key=residuals.__getitem__)
        raise LogError(
            f"chi2 = {chi2:.3g} per degree of freedom: must be below {MOST_CHI2:g}; {worst} is "
            f"{residuals[worst]:.3g} standard deviations off: the log is of another machine or "
            "motion than the model's, its noise is larger, or more parameters must be free, slope "
            "for one"
        )
    values, off = fit.value(q), np.abs(q) * [name not in TOLERANCES for name in free]
    if covariance is None and off.max() > FARTHEST:
        far = off.argmax()
        raise LogError(
            f"{free[far]} = {values[far]:.4g}: is {off[far]:.3g} standard deviations from what was "
            f"known, {getattr(params, free[far]):.4g}; must be within {FARTHEST:g}: other units in "
            "the log, or another machine? If it was not known so well, give its tolerance"
        )
    try:
        machine = Design.of(*free).machine(params, values)
    except ValueError as error:
        raise LogError(f"the log is explained best by a machine that cannot be: {error}") from error
    shares, directions = np.linalg.eigh(system.information)
    unidentifiable = tuple(
        {free[i]: float(v[i]) for i in np.argsort(-np.abs(v)) if abs(v[i]) > 0.1}
        for share, v in zip(shares, directions.T, strict=True)
        if share < LEAST_INFORMATION
    )
    shown = system.information / max(chi2, 1.0)
    after = np.linalg.inv(shown + prior) * np.outer(scale, scale)
    return Identification(
        *(machine, params, free, scale, after, unidentifiable, residuals, chi2, system.compared),
        left_out=1 - system.compared / compared,
    )


def physical(params: WheelParams) -> tuple[str, ...]:
    """Those of `PHYSICAL` that a machine has."""
    return tuple(name for name in PHYSICAL if getattr(params, name))


def machines_within(params: WheelParams, share: float, draws: Floats) -> tuple[WheelParams, ...]:
    """N machines whose `physical` parameters, k of them, are within a share of those of `params`.

    `draws` (N, k) in [-1, 1] say where in this range.
    """
    names = physical(params)
    known = np.array([getattr(params, name) for name in names])
    rows = (1.0 + share * draws) * known
    return tuple(dataclasses.replace(params, **dict(zip(names, row, strict=True))) for row in rows)


def _has(log: Log, name: str) -> bool:
    return getattr(log, name) is not None


def tolerances(
    params: WheelParams,
    free: tuple[str, ...],
    tolerance: float | Mapping[str, float] = TOLERANCE,
) -> Floats:
    """The standard deviations (k,) of the parameters before; see `identify`."""
    _require_motion(params, free)
    share = TOLERANCE if isinstance(tolerance, Mapping) else positive("tolerance", tolerance)
    given = tolerance if isinstance(tolerance, Mapping) else {}
    if unknown := [name for name in given if name not in free]:
        raise ValueError(f"tolerance: {', '.join(unknown)} is not free; free is {', '.join(free)}")
    scales = []
    for name in free:
        usual = TOLERANCES.get(name, share * abs(getattr(params, name)))
        if not usual and name not in given:
            raise ValueError(f"{name} = 0: give its tolerance, in its unit")
        scales.append(positive(f"tolerance of {name}", given.get(name, usual)))
    return np.array(scales)


def _require_motion(params: WheelParams, free: tuple[str, ...]) -> None:
    """Refuse names that are not those of different parameters of the motion."""
    for name in free:
        if name in ("friction", "voltage_limit", "idle_power", "pendulum_reach") or not isinstance(
            getattr(params, str(name), None), float
        ):
            raise ValueError(
                f"free = {name!r}: no parameter of the motion; choose from {', '.join(PHYSICAL)}, "
                f"{', '.join(TOLERANCES)}"
            )
    if not free or len(set(free)) < len(free):
        raise ValueError(f"free = {free}: name one parameter or more, each once")


def _covariance(covariance: Floats, k: int) -> Floats:
    """A covariance of k parameters as an array; refuses a matrix that is none."""
    given = real_array("covariance", covariance)
    if given.shape != (k, k):
        raise ValueError(f"covariance: has shape {given.shape}; must be {(k, k)}")
    if np.isfinite(given).all() and (np.diag(given) > 0).all():
        deviations = np.sqrt(np.diag(given))  # of parameters in different units
        correlation = given / np.outer(deviations, deviations)
        if np.allclose(correlation, correlation.T) and np.linalg.eigvalsh(correlation)[0] > 0:
            return given
    raise ValueError("covariance: must be finite, symmetric and positive definite")


class _Pieces(NamedTuple):
    """P pieces of a log, padded to the length of the longest."""

    begins: Any  # index of the first sample of each, shape (P,)
    inside: Any  # which samples exist, shape (P, length)
    mode: Any  # shape (P,)
    states: Floats  # at the first samples, shape (P, 4)


class _System(NamedTuple):
    """The Gauss-Newton system of the parameters, in tolerances."""

    information: Floats  # of the log alone, without what was known before, shape (k, k)
    gradient: Floats  # of half the squares, shape (k,)
    squares: float  # of all residuals
    rms: Floats  # of the residuals by channel
    compared: int  # how many residuals there are
    # by how much each piece's state changes: own step (P, 4), and per step of the parameters (P, 4,
    # k)
    back: tuple[Floats, Floats]
    by_piece: Floats  # squared residuals, shape (P,)


@dataclasses.dataclass(frozen=True)
class _Fit:
    """A log and what is sought from it; `q` are the parameters' changes in tolerances."""

    log: Log
    params: WheelParams
    free: tuple[str, ...]
    scale: Floats
    prior: Floats  # the information of what is known before, (k, k)
    channels: tuple[str, ...]
    noise: Noise

    def value(self, q: Floats) -> Floats:
        """The parameters."""
        return np.array([getattr(self.params, name) for name in self.free]) + q * self.scale

    def pieces(self, longest: float, starts: Mapping[int, Floats]) -> _Pieces:
        """Every stance in equal pieces; states from `starts` or from the samples.

        Samples about which another foot may have touched the ground are in none.
        """
        log, most = self.log, max(round(longest / self.log.period), FEWEST)
        changes = np.flatnonzero((np.diff(log.foot) != 0) | (np.diff(log.mode) != 0)) + 1
        alone = self._touching()
        stances = np.unique([0, *changes, *alone, *alone + 1, len(log)])
        found = []
        for begin, end in pairwise(stances.tolist()):
            if end - begin >= FEWEST:
                parts = math.ceil((end - begin) / most)
                edges = np.linspace(begin, end, parts + 1).astype(int).tolist()
                found += [(a, b) for a, b in pairwise(edges) if b - a >= FEWEST]
        if not found:
            raise LogError(f"no {FEWEST} samples follow each other on the same foot; log longer")
        begins, ends = np.array(found).T
        inside = np.arange((ends - begins).max()) < (ends - begins)[:, None]
        states = np.array([starts.get(b, self._guess(b, e)) for b, e in found])
        return _Pieces(begins, inside, log.mode[begins], states)

    def _touching(self) -> NDArray[np.int64]:
        """Samples where the leg turns back so near to a touchdown that it may have touched down.

        A wheel that rocks touches down and comes back between two samples, and the log does not
        show it.
        """
        log, c = self.log, self.params.constants
        left, moved = np.minimum(log.phi - c.a, c.b - log.phi), np.abs(np.diff(log.phi))
        reach = np.maximum(moved[:-1], moved[1:]) + SHORT_OF * self.noise.angle
        turns = (left[1:-1] <= left[:-2]) & (left[1:-1] <= left[2:]) & (left[1:-1] < reach)
        same = (np.diff(log.foot[:-1]) == 0) & (np.diff(log.foot[1:]) == 0)
        return np.flatnonzero(turns & same & (log.mode[1:-1] == SINGLE)) + 1

    def _guess(self, begin: int, end: int) -> Floats:
        """The state at a sample, from a parabola through the next few."""
        few = slice(begin, min(end, begin + 8))
        t = self.log.time[few] - self.log.time[begin]
        angles = np.stack([self.log.phi[few], np.unwrap(self.log.theta)[few]], axis=1)
        fitted = np.polynomial.polynomial.polyfit(t, angles, 2)
        return np.concatenate([fitted[0], fitted[1]])

    def without_worst(self, pieces: _Pieces, system: _System) -> _Pieces | None:
        """The pieces but for the one with the largest residuals; None if none is an `OUTLIER`.

        In that piece the foot may have lifted off, or touched down, between two samples.
        """
        number = pieces.inside.sum(axis=1) * len(self.channels)
        each = system.by_piece / np.maximum(number - 4, 1)
        worst = int(each.argmax())
        if not each[worst] > OUTLIER * np.median(each):
            return None
        return _Pieces(*(np.delete(part, worst, axis=0) for part in pieces))

    def solved(self, pieces: _Pieces, q: Floats) -> tuple[Floats, _Pieces, _System]:
        """Gauss and Newton's method with halved steps."""
        system = self.system(pieces, q)
        for _ in range(STEPS):
            step = np.linalg.solve(
                system.information + self.prior, -system.gradient - self.prior @ q
            )
            share, cost = 1.0, system.squares + q @ self.prior @ q
            own, per = system.back
            for _ in range(HALVINGS):
                further = q + share * step
                moved = pieces._replace(states=pieces.states + share * (own + per @ step))
                tried = self.system(moved, further)
                if tried.squares + further @ self.prior @ further <= cost:
                    break
                share /= 2
            else:
                return q, pieces, system
            q, pieces, system = further, moved, tried
            if np.abs(share * step).max() < SMALL:
                break
        return q, pieces, system

    def system(self, pieces: _Pieces, q: Floats) -> _System:
        """The system about a point; of infinite squares for a machine that cannot be."""
        k, p, before = len(q), self.value(q), self.value(np.zeros(len(q)))
        n, channels = len(pieces.begins), len(self.channels)
        refused = _System(
            *(np.eye(k), q, math.inf, np.full(channels, math.inf), 0),
            *((np.zeros((n, 4)), np.zeros((n, 4, k))), np.full(n, math.inf)),
        )
        wrong = np.where(before == 0, p < 0, p * before <= 0)
        if wrong[[name != "slope" for name in self.free]].any():
            return refused
        r, J = self.residuals(pieces, p)
        J[..., 4:] *= self.scale
        flat, rows = J.reshape(n, -1, 4 + k), r.reshape(n, -1)
        H = flat.swapaxes(1, 2) @ flat
        g = np.einsum("nij,ni->nj", flat, rows)
        H[:, :4, :4] += np.diag(FREE_START**-2)
        try:
            inverse = np.linalg.inv(H[:, :4, :4])
        except np.linalg.LinAlgError:  # the motion has diverged
            return refused
        own, per = -np.einsum("nij,nj->ni", inverse, g[:, :4]), -inverse @ H[:, :4, 4:]
        information = (H[:, 4:, 4:] + H[:, 4:, :4] @ per).sum(axis=0)
        gradient = (g[:, 4:] + np.einsum("nij,nj->ni", H[:, 4:, :4], own)).sum(axis=0)
        squares = float((r**2).sum())
        if not (math.isfinite(squares) and np.isfinite(information).all()):
            return refused
        number = int(pieces.inside.sum())
        rms = np.sqrt((r**2).sum(axis=(0, 1)) / number)
        compared = number * channels
        return _System(
            *(0.5 * (information + information.T), gradient, squares, rms, compared, (own, per)),
            (r**2).sum(axis=(1, 2)),
        )

    def residuals(self, pieces: _Pieces, p: Floats) -> tuple[Floats, Floats]:
        """Residuals (P, length, channels) in standard deviations, and derivatives (.., 4 + k)."""
        n, length = pieces.inside.shape
        k, log = len(p), self.log
        longest = min(STEP, 1 / self.params.motor_pole)
        substeps = math.ceil(log.period / longest - 1e-9)
        measured, sd = self._measured()
        free = {name: getattr(BUILDABLE, name) for name in self.free}  # alike for all: p counts
        model = dataclasses.replace(self.params, pendulum_reach=None, **free)
        r = np.zeros((n, length, len(self.channels)))
        J = np.zeros((*r.shape, 4 + k))
        x, S = pieces.states.copy(), np.zeros((n, 4, 4 + k))
        S[:, :, :4] = np.eye(4)
        chosen = [("phi", "theta", "dphi", "dtheta", "current").index(c) for c in self.channels]
        for s in range(length):
            alive = np.flatnonzero(pieces.inside[:, s])
            samples = pieces.begins[alive] + s
            y, C, D, after, A, B = _step(
                *(model, self.free, substeps, log.period),
                *(pieces.mode[alive], x[alive], log.voltage[samples], p),
            )
            error = y[:, chosen] - measured[samples]
            turn = np.array([c == "theta" for c in self.channels]) * 2 * np.pi
            error -= turn * np.round(error / (2 * np.pi))
            r[alive, s] = error / sd
            total = C @ S[alive]
            total[:, :, 4:] += D
            J[alive, s] = total[:, chosen] / sd[:, None]
            x[alive] = after
            S[alive] = A @ S[alive]
            S[alive, :, 4:] += B
        return r, J

    def _measured(self) -> tuple[Floats, Floats]:
        """Samples (n, channels), and the standard deviations of their errors (channels,)."""
        kind = {"phi": "angle", "theta": "angle", "current": "current"}
        sd = [getattr(self.noise, kind.get(name, "rate")) for name in self.channels]
        return np.stack([getattr(self.log, name) for name in self.channels], 1), np.array(sd)


def _step(
    params: WheelParams,
    free: tuple[str, ...],
    substeps: int,
    period: float,
    mode: Any,
    x: Floats,
    u: Floats,
    p: Floats,
) -> tuple[Floats, ...]:
    """Of states (P, 4) in their modes: what is measured, the state a sample later, derivatives.

    Returns y (P, 5) with derivatives (P, 5, 4) by x and (P, 5, k) by p, and the next x with its.
    """
    k, out = len(p), [np.empty((len(x), *shape)) for shape in _shapes(len(p))]
    for each in (SINGLE, DOUBLE):
        rows = np.flatnonzero(mode == each)
        if len(rows):
            mapped = _mapped(params, free, substeps, each, len(rows))
            results = mapped(x[rows].T, u[rows][None], p, period / substeps)
            for place, result, shape in zip(out, results, _shapes(k), strict=True):
                place[rows] = result.full().T.reshape(len(rows), *shape[::-1]).swapaxes(1, -1)
    return tuple(out)


def _shapes(k: int) -> tuple[tuple[int, ...], ...]:
    return (5,), (5, 4), (5, k), (4,), (4, 4), (4, k)


@lru_cache(maxsize=256)
def _mapped(
    params: WheelParams, free: tuple[str, ...], substeps: int, mode: int, n: int
) -> ca.Function:
    """`_stepping` for n wheels of the same parameters."""
    return _stepping(params, free, substeps, mode).map("steps", "serial", n, [2, 3], [])


@lru_cache(maxsize=16)
def _stepping(params: WheelParams, free: tuple[str, ...], substeps: int, mode: int) -> ca.Function:
    """x, u, p, h -> y, dy/dx, dy/dp, the next x, dx/dx, dx/dp; derivatives as columns."""
    functions = HybridModel(params, Design.of(*free)).functions
    flow = functions["flow" if mode == SINGLE else "flow_double_stance"]
    x, u, p, h = ca.SX.sym("x", 4), ca.SX.sym("u"), ca.SX.sym("p", len(free)), ca.SX.sym("h")
    y, after = ca.vertcat(x, functions["motor_current"](x, u, p)), x
    for _ in range(substeps):
        k1 = flow(after, u, p)
        k2 = flow(after + h / 2 * k1, u, p)
        k3 = flow(after + h / 2 * k2, u, p)
        k4 = flow(after + h * k3, u, p)
        after = after + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    out = [
        ca.densify(ca.vec(each))
        for value in (y, after)
        for each in (value, ca.jacobian(value, x), ca.jacobian(value, p))
    ]
    return ca.Function("step", [x, u, p, h], ca.cse(out))
