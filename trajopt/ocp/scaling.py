"""The scales of a problem: what counts as one, of every state, control, duration, cost and row.

A problem in any units becomes a program of numbers around one, and errors are stated relative to
scales, so that no result depends on the units. A scale is the magnitude along a trajectory: the
guess for the program that starts there, the solution for its errors. Where the guess is zero, it is
that of the bounds, and otherwise follows from the differential equations: in x' = f(x, u), each
term of f changes x by its scale in about a duration.

Scales are powers of ten: multiplying a unit by a power of ten leaves the scaled program as it is,
and quantities around one are not scaled.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from trajopt.ocp.arrays import Array, Indices
from trajopt.ocp.constraints import pair
from trajopt.ocp.layout import Key, Layout, evaluated, middle, running_cost
from trajopt.ocp.problem import Phase, Problem
from trajopt.ocp.schemes import lagrange_matrix
from trajopt.ocp.trajectory import PhaseTrajectory

#: Least scale of a state or control, relative to what the differential equations imply, and of the
#: cost, relative to what it is around the trajectory. Without them, the scale of a quantity that
#: stays zero would be rounding.
FLOOR, COST_FLOOR = 1e-3, 1e-4

#: Quantities below 10 to this power count as one, those above 10 to one more as ten.
ROUNDING = 0.55

#: Where a phase is sampled, as fractions of its duration; and in which directions around it.
PLACES = (np.arange(16) + 0.5) / 16
DIRECTIONS = 4

#: Rounds of the balance of units, and the misfit (decades) beyond which an equation counts less.
ROUNDS, MISFIT = 5, 0.3


@dataclasses.dataclass(frozen=True, eq=False)
class PhaseScales:
    """Scales of a phase: of states (nx,), controls (nu,), the duration (s), and rows.

    The rows are those of the powers, and of path, integral, start and end constraints.
    """

    states: Array
    controls: Array
    duration: float
    powers: Array
    path: Array
    integral: Array
    at_start: Array
    at_end: Array


@dataclasses.dataclass(frozen=True, eq=False)
class Scales:
    """Scales of a problem: its phases, static parameters (np,), boundary rows, and its cost."""

    phases: tuple[PhaseScales, ...]
    parameters: Array
    boundary: Array
    cost: float

    @property
    def flat(self) -> Array:
        """The scales of unknowns and cost as one vector."""
        parts = [np.r_[s.states, s.controls, s.duration] for s in self.phases]
        return np.concatenate([*parts, self.parameters, [self.cost]])

    def of_unknowns(self, layout: Layout) -> Array:
        """The scales of a program's unknowns, shape (layout.size,)."""
        parts: dict[Key, Array] = {(-1, "parameters", 0): self.parameters[:, None]}
        for key, (rows, _) in layout.shapes.items():
            index, kind, _ = key
            if index >= 0:
                s = self.phases[index]
                each = {"duration": np.array([s.duration]), "slacks": s.powers}
                each |= dict.fromkeys(("edges", "interior"), s.states)
                unit = each.get(kind, s.controls)
                parts[key] = np.tile(unit, rows // max(len(unit), 1))[:, None]
        return layout.join(parts)


@np.errstate(invalid="ignore")  # functions need not be finite everywhere
def scales_of(
    problem: Problem, trajectory: Sequence[PhaseTrajectory], parameters: Array | None = None
) -> Scales:
    """The scales along a trajectory."""
    p = middle(problem) if parameters is None else np.asarray(parameters, dtype=float)
    balance = _Balance(problem, trajectory, p)
    units = balance.floored(balance.implied(balance.known)[0])
    *each, of_parameters = balance.split(units)
    samples = [
        _sampled(phase, path, states, controls)
        for phase, path, (states, controls, _) in zip(problem.phases, trajectory, each, strict=True)
    ]
    parts = zip(problem.phases, trajectory, each, samples, strict=True)
    ends = _ends(trajectory, each, p)
    boundary = problem.boundary and problem.boundary.function
    return Scales(
        phases=tuple(_phase_scales(*part, p) for part in parts),
        parameters=_rounded(of_parameters[0]),
        boundary=_changes(boundary, ends),
        cost=float(_rounded(_cost_scale(problem, trajectory, samples, ends, p))),
    )


def implied_durations(problem: Problem, trajectory: Sequence[PhaseTrajectory]) -> Array:
    """The durations (s) that the differential equations imply, given a trajectory's states.

    NaN where they imply none; shape (phases,).
    """
    balance = _Balance(problem, trajectory, middle(problem))
    known = balance.known.copy()
    for i, phase in enumerate(problem.phases):
        least, most = pair(phase.duration)
        if least < most:
            known[balance.places[i].duration] = 0.0
    values, determined = balance.implied(known)
    where = np.concatenate([place.duration for place in balance.places])
    fixed = known[where] > 0.0
    return np.where(fixed, known[where], np.where(determined[where], values[where], np.nan))


# -- the balance of units -------------------------------------------------------------------------


class _Place(NamedTuple):
    """Where the units of a phase stand in the vector of all."""

    states: Indices
    controls: Indices
    duration: Indices


class _Balance:
    """The units of all states, controls, durations and parameters, as one vector.

    Attributes:
        places: of every phase's units; those of the parameters are the last.
        known: magnitudes along the trajectory, or else of the bounds; 0 if these have none.
        samples: of every phase, around the trajectory by what is known.
        slopes: of every phase, how large derivatives of its flow are, (nx, nx + nu + np).
        rates: of every phase, how large its flow is, (nx,).
    """

    def __init__(self, problem: Problem, trajectory: Sequence[PhaseTrajectory], p: Array) -> None:
        self.problem, self.trajectory, self.p = problem, trajectory, p
        self.places: list[_Place] = []
        first = 0
        for phase in problem.phases:
            cuts = np.cumsum([first, len(phase.states), len(phase.controls), 1])
            self.places.append(_Place(*map(np.arange, cuts[:-1], cuts[1:])))
            first = int(cuts[-1])
        self.parameters = np.arange(first, first + len(p))
        self.count = first + len(p)
        self.known = self._magnitudes()
        self.samples: list[_Samples] = []
        self.slopes: list[Array] = []
        self.rates: list[Array] = []
        for phase, path, place in zip(problem.phases, trajectory, self.places, strict=True):
            samples = _sampled(phase, path, self.known[place.states], self.known[place.controls])
            self.samples.append(samples)
            values, slopes = _largest(phase.flow, samples, p), jacobian(phase.flow)
            self.rates.append(values)
            self.slopes.append(_largest(slopes, samples, p).reshape(-1, len(values)).T)

    def split(self, units: Array) -> list[tuple[Array, ...]]:
        """(states, controls, duration) of every phase, and last (parameters,)."""
        each = [tuple(units[where] for where in place) for place in self.places]
        return [*each, (units[self.parameters],)]

    def _magnitudes(self) -> Array:
        units = np.zeros(self.count)
        for phase, path, place in zip(
            self.problem.phases, self.trajectory, self.places, strict=True
        ):
            every = [b for end in ("all along", "start", "end") for b in phase.state_bounds(end)]
            units[place.states] = _first(np.abs(path.states).max(axis=(0, 1)), every)
            controls = np.abs(path.controls).max(axis=(0, 1), initial=0.0)
            units[place.controls] = _first(controls, phase.control_bounds())
            units[place.duration] = path.duration
        bounds = np.array([pair(b) for b in self.problem.parameters.values()]).reshape(-1, 2)
        units[self.parameters] = _first(np.abs(self.p), [*bounds.T])
        return units

    def implied(self, known: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Units that balance the equations with the `known` ones, and which are determined.

        Every term of x' = f, times the duration, has about the unit of x; every term of a linkage
        that of its target; and a constraint has terms of about one size. In logarithms, that is a
        linear system. Its solution ignores outliers: terms without weight.
        """
        unknown = known <= 0.0
        if not unknown.any():
            return known, ~unknown
        rows, right = [], []
        for (plus, minus), size in self._terms():
            row = np.zeros(self.count)
            np.add.at(row, plus, 1.0)
            np.add.at(row, minus, -1.0)
            rows.append(row)
            right.append(np.log10(size))
        b = np.array(right)
        A = np.array(rows).reshape(len(b), self.count)
        asked = np.any(A[:, unknown] != 0.0, axis=1)
        b = b[asked] - A[asked][:, ~unknown] @ np.log10(known[~unknown])
        M, weights = A[asked][:, unknown], np.ones(len(b))
        for _ in range(ROUNDS):
            inverse = np.linalg.pinv(weights[:, None] * M)
            logs = inverse @ (weights * b)
            weights = 1 / np.sqrt(np.maximum(np.abs(M @ logs - b), MISFIT))
        units, determined = known.copy(), ~unknown
        units[unknown] = 10.0**logs
        determined[unknown] = np.diag(np.linalg.pinv(M) @ M) > 1 - 1e-6
        return units, determined

    def _terms(self) -> Iterator[tuple[tuple[list[int], list[int]], float]]:
        """Of every term of an equation: the units it divides and multiplies, and its size."""
        for place, slopes, rates in zip(self.places, self.slopes, self.rates, strict=True):
            columns = [*place.states, *place.controls, *self.parameters]
            (duration,) = place.duration
            for i, state in enumerate(place.states):
                if rates[i] > 0.0:
                    yield ([state], [duration]), rates[i]
                for j, column in enumerate(columns):
                    if column != state and slopes[i, j] > 0.0:
                        yield ([state], [duration, column]), slopes[i, j]
        for phase, samples, place in zip(
            self.problem.phases, self.samples, self.places, strict=True
        ):
            columns = [*place.states, *place.controls]
            for constraint in filter(None, (phase.path, phase.integral)):
                orders = _expansion(constraint.function)
                value, slope, curvature = (_largest(order, samples, self.p) for order in orders)
                for n, derivative in ((1, slope), (2, curvature)):
                    each = derivative.reshape(len(columns), len(value))
                    for j, i in np.argwhere((each > 0.0) & (value > 0.0)):
                        yield ([columns[j]] * n, []), n * value[i] / each[j, i]
        for link in self.problem.linkages:
            source, target = self.places[link.source].states, self.places[link.target].states
            end = self.trajectory[link.source].end
            slopes = np.abs(
                jacobian(link.map)(end, self.p).full().reshape(len(target), -1, order="F")
            )
            for i, j in np.argwhere((slopes > 0.0) & np.isfinite(slopes)):
                if j < len(source) and target[i] != source[j]:
                    yield ([target[i]], [source[j]]), slopes[i, j]

    def floored(self, units: Array) -> Array:
        """The units, none below `FLOOR` of what the differential equations imply."""
        units = units.copy()
        for place, slopes in zip(self.places, self.slopes, strict=True):
            T, nx = units[place.duration[0]], len(place.states)
            columns = np.concatenate([place.states, place.controls, self.parameters])
            relaxed = 1.0 / T + np.diag(slopes[:, :nx])
            others = slopes * (1.0 - np.eye(*slopes.shape))
            for _ in range(nx):  # a chain of integrators passes a unit on from state to state
                changes = (others * units[columns]).max(axis=1, initial=0.0) / relaxed
                units[place.states] = np.maximum(units[place.states], FLOOR * changes)
            gains = T * slopes[:, nx : nx + len(place.controls)]
            with np.errstate(divide="ignore"):
                needed = (units[place.states][:, None] / gains).min(axis=0, initial=np.inf)
            needed = np.where(np.isfinite(needed), needed, 0.0)
            units[place.controls] = np.maximum(units[place.controls], FLOOR * needed)
        return units


def _first(magnitudes: Array, bounds: Sequence[Array]) -> Array:
    """The magnitudes, or those of the bounds where they are zero."""
    finite = [np.where(np.isfinite(b), np.abs(b), 0.0) for b in bounds]
    return np.where(magnitudes > 0.0, magnitudes, np.max(finite, axis=0))


@lru_cache(maxsize=64)
def jacobian(function: ca.Function) -> ca.Function:
    """The derivatives of a traced function with respect to all its arguments, in columns."""
    arguments = function.sx_in()
    slopes = ca.jacobian(function(*arguments), ca.vertcat(*arguments))
    return ca.Function("jacobian", arguments, [ca.vec(ca.densify(slopes))])


@lru_cache(maxsize=64)
def _expansion(function: ca.Function) -> tuple[ca.Function, ...]:
    """A traced function of (x, u, p), its derivatives with respect to x and u, and second ones.

    Those are the derivatives with respect to each variable alone, in columns.
    """
    x, u, p = function.sx_in()
    v, value = ca.vertcat(x, u), function(x, u, p)
    slopes = ca.densify(ca.jacobian(value, v))
    rows = [ca.diag(ca.hessian(row, v)[0]).T for row in ca.vertsplit(value)]
    outputs = slopes, ca.densify(ca.vertcat(*rows))
    return function, *(ca.Function("order", [x, u, p], [ca.vec(out)]) for out in outputs)


# -- rows and cost --------------------------------------------------------------------------------


class _Samples(NamedTuple):
    """States and controls of a phase, (1 + directions, places, .): along it, then around it."""

    states: Array
    controls: Array


def _sampled(phase: Phase, path: PhaseTrajectory, *units: Array) -> _Samples:
    times, sampled = path.duration * PLACES, []
    along = path.state(times), path.control(times)
    limits = phase.state_bounds(), phase.control_bounds()
    for values, unit, bounds in zip(along, units, limits, strict=True):
        around = np.clip(values + unit * _directions(*values.shape), *bounds)
        sampled.append(np.concatenate([values[None], around]))
    return _Samples(*sampled)


@lru_cache(maxsize=64)
def _directions(*shape: int) -> Array:
    return np.random.default_rng(0).uniform(-1.0, 1.0, (DIRECTIONS, *shape))


def _largest(function: Any, samples: _Samples, p: Array) -> Array:
    """Largest magnitudes of a function along a phase, or typical ones around it if larger."""
    sizes = np.abs(evaluated(function, *samples, p))
    along = np.where(np.isfinite(sizes[0]), sizes[0], 0.0).max(axis=0)
    return np.maximum(along, _typical(sizes[1:], None, 0.0))


def _phase_scales(
    phase: Phase, path: PhaseTrajectory, units: tuple[Array, ...], samples: _Samples, p: Array
) -> PhaseScales:
    states, controls, (duration,) = units
    powers = np.zeros(0)
    if phase.powers is not None:
        powers = _largest(phase.powers, samples, p)
        powers = np.where(powers > 0.0, powers, 1.0)
    limits = integral = np.zeros(0)
    if phase.path is not None:
        values = evaluated(phase.path.function, *samples, p)
        limits = _typical(np.abs(values[1:] - values[0]), values[0])
    if phase.integral is not None:
        rates = evaluated(phase.integral.function, *samples, p)[1:]
        integral = duration * _typical(np.abs(rates))
    ends = [
        _changes(c and c.function, [(end, states), (p, 0.0 * p)])
        for c, end in ((phase.at_start, path.start), (phase.at_end, path.end))
    ]
    rounded = (_rounded(v) for v in (states, controls, duration, powers, limits, integral))
    s, u, T, *rows = rounded
    return PhaseScales(s, u, float(T), *rows, *ends)


def _ends(
    trajectory: Sequence[PhaseTrajectory], units: Sequence[tuple[Array, ...]], p: Array
) -> list[tuple[Array, Array]]:
    """The arguments of functions of all ends, and their units."""
    states = np.concatenate([each[0] for each in units])
    starts, ends = (np.concatenate([getattr(t, e) for t in trajectory]) for e in ("start", "end"))
    durations = np.array([t.duration for t in trajectory])
    return [(starts, states), (ends, states), (durations, 0.5 * durations), (p, 0.0 * p)]


def _moved(arguments: Sequence[tuple[Array, Array]]) -> Iterator[list[Array]]:
    """The arguments, moved by their units in several directions."""
    directions = _directions(sum(len(values) for values, _ in arguments))
    cuts = np.cumsum([len(values) for values, _ in arguments])[:-1]
    for each in directions:
        parts = np.split(each, cuts)
        yield [values + unit * s for (values, unit), s in zip(arguments, parts, strict=True)]


def _changes(function: Any, arguments: Sequence[tuple[Array, Array]]) -> Array:
    """By how much a function's values typically change if its arguments change by their units."""
    if not function:
        return np.zeros(0)
    at = function(*(values for values, _ in arguments)).full().ravel()
    moved = [function(*values).full().ravel() for values in _moved(arguments)]
    return _rounded(_typical(np.abs(np.array(moved) - at), at))


def _cost_scale(
    problem: Problem,
    trajectory: Sequence[PhaseTrajectory],
    samples: Sequence[_Samples],
    ends: Sequence[tuple[Array, Array]],
    p: Array,
) -> Array:
    """The integral of the running cost's magnitude and the endpoint cost's, none too small."""
    along = around = 0.0
    for phase, path, sampled in zip(problem.phases, trajectory, samples, strict=True):
        u = lagrange_matrix(path.control_nodes, path.nodes) @ path.controls
        rates = np.abs(running_cost(phase, path.states, u, p))
        rates = np.where(np.isfinite(rates), rates, 0.0)
        along += float(path.element_durations @ rates.mean(axis=1))
        rates = running_cost(phase, *sampled, p)[1:]
        around += path.duration * float(_typical(np.abs(rates[..., None]), None, 0.0)[0])
    if problem.endpoint_cost is not None:
        at = float(problem.endpoint_cost(*(values for values, _ in ends)))
        moved = [float(problem.endpoint_cost(*values)) for values in _moved(ends)]
        along += abs(at) if np.isfinite(at) else 0.0
        around += float(_typical(np.abs(np.array(moved)[:, None] - at), None, 0.0)[0])
    scale = max(along, COST_FLOOR * around) if along > 0.0 else around
    return np.array(scale or 1.0)


def _typical(sizes: Array, otherwise: Array | None = None, last: float = 1.0) -> Array:
    """The medians of the sizes (..., m) that are neither 0 nor infinite, shape (m,).

    Where there are none, of the magnitudes `otherwise`, and `last` if there are none either.
    """
    columns = sizes.reshape(-1, sizes.shape[-1])
    used = np.isfinite(columns) & (columns > 0.0)
    ordered, count = np.sort(np.where(used, columns, np.inf), axis=0), used.sum(axis=0)
    middle = np.array([np.maximum(count - 1, 0) // 2, count // 2])
    medians = ordered[np.minimum(middle, len(ordered) - 1), np.arange(len(count))].mean(axis=0)
    found = np.where(count > 0, medians, 0.0)
    if otherwise is not None:
        found = np.where(found > 0.0, found, _typical(np.abs(otherwise)))
    return np.where(found > 0.0, found, last)


def _rounded(units: Any) -> Array:
    """The units as powers of ten."""
    return np.asarray(10.0 ** np.round(np.log10(units) - (ROUNDING - 0.5)))
