"""The periodic gait under a held voltage as a nonlinear program, solved by IPOPT."""

from __future__ import annotations

import dataclasses
import math
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import HybridModel
from trajopt.gaits.held_stride import LEAST_SHARE, HeldStride, Pattern, bounded
from trajopt.gaits.problem import STATES, WheelPhases
from trajopt.ocp.arrays import Array, Indices
from trajopt.ocp.equations import element, path_nodes
from trajopt.ocp.problem import Phase
from trajopt.ocp.program import Block, assembled
from trajopt.ocp.schemes import SCHEMES, Scheme, lagrange_matrix
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.ocp.transcription import INTERRUPTED, IPOPT, QUIET, interruptible

#: Degree of the states within an interval, and the scheme with a constant control.
DEGREE = 4
SCHEME: Scheme = SCHEMES["radau"].of_degree(DEGREE, 0)

#: Where in an interval the objective takes the power, and the trapezoidal rule's weights. While
#: the wheel coasts, the current changes sign within most intervals. Of max(V i, 0), which is convex
#: there, this rule takes too much (by 1e-4 of the whole), where Gauss's or the midpoint rule takes
#: too little, which an optimisation would exploit.
POWER_AT: Array = np.linspace(0.0, 1.0, 21)
WEIGHTS: Array = np.convolve(np.ones(len(POWER_AT) - 1), [0.5, 0.5]) / (len(POWER_AT) - 1)

#: Places in an interval without a touchdown at which phi is kept away from the guards, besides the
#: nodes, because a leg may rock back and almost touch down. It keeps a distance of GRAZE hold^2
#: (rad). Between two places phi can go 0.0016 phi'' hold^2 further, so this suffices up to a phi''
#: of 12 rad/s^2.
GUARDED_AT: Array = np.arange(1, 9) / 9.0
GRAZE = 0.02

NX, INNER, PHI = len(STATES), len(SCHEME.nodes) - 2, STATES.index("phi")

#: How much above the powers of a guess its slacks begin (W).
SLACK = 1e-2


@dataclasses.dataclass(frozen=True)
class HeldOptimum:
    """What IPOPT returned."""

    stride: HeldStride  # the solution
    energy: float  # of a stride by the program (J), idle left out
    success: bool  # whether IPOPT succeeded
    status: str  # IPOPT's name for it


class HeldLayout:
    """Where each unknown is in the vector of all.

    Attributes:
        edges: for each step, the states at touchdowns and ticks, (whole + 3, 4).
        inner: for each step, the states at the nodes inside its elements, (whole + 2, nodes, 4).
        slacks: for each step, those of its elements, (whole + 2, slacks).
        voltages: (ticks,).
        shares: (steps,).
        size: how many unknowns there are.
    """

    def __init__(self, pattern: Pattern, slacks: int) -> None:
        self.size = 0
        elements = [whole + 2 for whole in pattern.whole]
        self.edges = [self._next(e + 1, NX) for e in elements]
        self.inner = [self._next(e, INNER, NX) for e in elements]
        self.slacks = [self._next(e, slacks) for e in elements]
        self.voltages, self.shares = self._next(pattern.ticks), self._next(pattern.steps)

    def _next(self, *shape: int) -> Indices:
        first = self.size
        self.size += math.prod(shape)
        return np.arange(first, self.size).reshape(shape)


class HeldProgram:
    """The least energy of a stride with a given pattern, the phase of the clock free within it.

    Args:
        params: the machine.
        pattern: in which intervals the touchdowns fall.
        theta_turns: whole turns that theta gains in a stride.
        regeneration: whether the battery takes energy back.
    """

    def __init__(
        self, params: WheelParams, pattern: Pattern, theta_turns: int, regeneration: bool
    ) -> None:
        self.params, self.pattern, self.theta_turns = params, pattern, theta_turns
        self.equations = interval_equations(params, pattern.hold, regeneration)
        self.layout = HeldLayout(pattern, self.equations.slacks)
        self.limits: list[tuple[Array, Array]] = []
        self.rows = 0
        blocks = list(self._blocks())
        self.program = assembled(blocks, self.layout.size, self.rows)

    @interruptible()
    def solve(self, guess: HeldStride, **options: Any) -> HeldOptimum:
        """A local optimum near a guess with the same pattern.

        Args:
            guess: where to start.
            options: of IPOPT, over `trajopt.ocp.transcription.IPOPT`.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed meanwhile.
        """
        settings: dict[str, Any] = {"ipopt": IPOPT | options, **QUIET}
        settings |= self.program.derivatives
        solver = ca.nlpsol("nlp", "ipopt", self.program.symbols, settings)
        lower, upper = self._bounds()
        least, most = (np.concatenate(side) for side in zip(*self.limits, strict=True))
        start = np.clip(self._packed(guess), lower, upper)
        solution = solver(x0=start, lbx=lower, ubx=upper, lbg=least, ubg=most)
        stats = solver.stats()
        if stats["return_status"] in INTERRUPTED:
            raise KeyboardInterrupt
        return HeldOptimum(
            self._unpacked(np.asarray(solution["x"]).ravel()),
            float(solution["f"]),
            bool(stats["success"]),
            str(stats["return_status"]),
        )

    # -- equations ----------------------------------------------------------------------------

    def _blocks(self) -> Any:
        pattern, layout, equations = self.pattern, self.layout, self.equations
        whole, parts, lengths = [], [], []
        for step in range(pattern.steps):
            columns = self._elements(step)
            whole.append(columns[:, 1:-1])
            shares = layout.shares[[step - 1, step]]
            parts.append(np.vstack([columns[:, [0, -1]], shares]))
            lengths.append([[1.0, 0.0], [-1.0, 1.0]])
        intervals = np.hstack(whole)
        if intervals.size:
            none = np.empty((0, intervals.shape[1]))
            yield self._block(equations.whole, intervals, none, equations.whole_bounds)
        bounds = equations.part_bounds
        yield self._block(equations.part, np.hstack(parts), np.hstack(lengths), bounds)
        lower, upper = equations.touchdown_bounds
        for step in range(pattern.steps):
            after = layout.edges[(step + 1) % pattern.steps][0]
            turned = np.zeros(len(lower))
            if step == pattern.steps - 1:
                turned[STATES.index("theta")] = -2 * math.pi * self.theta_turns
            states = np.concatenate([layout.edges[step][-1], after])[:, None]
            limits = lower + turned, upper + turned
            yield self._block(equations.touchdown, states, np.empty((0, 1)), limits)

    def _elements(self, step: int) -> Indices:
        """The unknowns of a step's elements but for shares, one column each."""
        layout = self.layout
        edges, inner, slacks = layout.edges[step], layout.inner[step], layout.slacks[step]
        volts = layout.voltages[self.pattern.voltages_of(step)]
        inside = inner.reshape(len(inner), -1)
        return np.hstack([edges[:-1], inside, edges[1:], volts[:, None], slacks]).T

    def _block(
        self, function: ca.Function, variables: Indices, data: Array, limits: tuple[Array, Array]
    ) -> Block:
        outputs, count = len(limits[0]), variables.shape[1]
        rows = self.rows + np.arange(outputs * count).reshape(outputs, count, order="F")
        self.rows += rows.size
        self.limits.append((np.tile(limits[0], count), np.tile(limits[1], count)))
        return Block(function, variables, rows, np.asarray(data, dtype=np.float64))

    # -- unknowns -----------------------------------------------------------------------------

    def _bounds(self) -> tuple[Array, Array]:
        layout, phase = self.layout, self.equations.phase
        lower, upper = np.full(layout.size, -np.inf), np.full(layout.size, np.inf)
        margin = GRAZE * self.pattern.hold**2
        for edges, inner, slacks in zip(layout.edges, layout.inner, layout.slacks, strict=True):
            for where, name, distance in (
                *((edges, "all along", 0.0), (inner, "all along", 0.0)),
                *((edges[2:-2], "all along", margin), (inner[1:-1], "all along", margin)),
                *((edges[0], "start", 0.0), (edges[-1], "end", 0.0)),
            ):
                lower[where], upper[where] = phase.state_bounds(name)
                lower[where[..., PHI]] += distance
                upper[where[..., PHI]] -= distance
            lower[slacks] = 0.0
        (lower[layout.voltages],), (upper[layout.voltages],) = phase.control_bounds()
        lower[layout.shares], upper[layout.shares] = LEAST_SHARE, 1.0 - LEAST_SHARE
        return lower, upper

    def _packed(self, guess: HeldStride) -> Array:
        layout, pattern, w = self.layout, self.pattern, np.zeros(self.layout.size)
        shares = bounded(guess.shares)
        w[layout.voltages], w[layout.shares] = guess.voltages, shares
        powers = HybridModel(self.params).functions["electrical_power"]
        basis = lagrange_matrix(SCHEME.nodes, POWER_AT)
        for step, phase in enumerate(guess.phases):
            edges = pattern.edges_of(step, shares)
            times = edges[:-1, None] + np.diff(edges)[:, None] * SCHEME.nodes
            times *= phase.duration / edges[-1]
            states = phase.state(times.ravel()).reshape(*times.shape, NX)
            w[layout.edges[step]] = np.vstack([states[:, 0], states[-1:, -1]])
            w[layout.inner[step]] = states[:, 1:-1]
            if layout.slacks[step].size:
                volts = np.repeat(guess.voltages[pattern.voltages_of(step)], len(POWER_AT))
                taken = np.asarray(powers((basis @ states).reshape(-1, NX).T, volts[None]))
                w[layout.slacks[step]] = np.maximum(taken, 0.0).reshape(-1, len(POWER_AT)) + SLACK
        return w

    def _unpacked(self, w: Array) -> HeldStride:
        layout, pattern, phases = self.layout, self.pattern, []
        shares, voltages = w[layout.shares], w[layout.voltages]
        for step in range(pattern.steps):
            edges, inner = w[layout.edges[step]], w[layout.inner[step]]
            states = np.concatenate([edges[:-1, None], inner, edges[1:, None]], axis=1)
            volts = voltages[pattern.voltages_of(step)]
            phases.append(
                PhaseTrajectory(
                    edges=pattern.edges_of(step, shares),
                    nodes=SCHEME.nodes,
                    states=states,
                    control_nodes=SCHEME.control_nodes,
                    controls=volts[:, None, None],
                )
            )
        return HeldStride(pattern, shares, voltages, tuple(phases))


# -- an interval, or one side of it, as an element of the program --------------------------------


@dataclasses.dataclass(frozen=True)
class IntervalEquations:
    """The functions of the program, and their bounds.

    The states of an element are its left end (4), the nodes inside (4 each) and its right end.
    """

    phase: Phase  # the step of which intervals are parts
    # (states, V, slacks) -> (defects, path constraints, slacks less powers, phi at `GUARDED_AT`),
    # cost
    whole: ca.Function
    # the same without phi, with the share of a touchdown after the slacks, and data (a, b): the
    # element's length is a + b share, in intervals
    part: ca.Function
    # (state before, state after) -> (mismatch, constraints at touchdown), no cost
    touchdown: ca.Function
    slacks: int  # how many
    whole_bounds: tuple[Array, Array]  # of the outputs of `whole`, (lower, upper)
    part_bounds: tuple[Array, Array]  # of those of `part`
    touchdown_bounds: tuple[Array, Array]  # of the outputs of `touchdown`, theta's turns left out


@lru_cache(maxsize=8)
def interval_equations(params: WheelParams, hold: float, regeneration: bool) -> IntervalEquations:
    """The functions of one machine, clock and objective."""
    wheel = WheelPhases(params)
    stance, c = wheel.single_stance(), params.constants
    bounds = {**stance.bounds, "phi": (c.a, c.b)}  # the program keeps phi off the guards
    phase = dataclasses.replace(stance, powers=None, bounds=bounds).traced(0)
    assert phase.path is not None
    assert phase.at_end is not None
    nx, n = len(STATES), len(SCHEME.nodes)
    slacks = 0 if regeneration else len(POWER_AT)
    x, u, s = ca.SX.sym("x", nx * n), ca.SX.sym("u"), ca.SX.sym("s", slacks)
    share, data, none = ca.SX.sym("share"), ca.SX.sym("d", 2), ca.SX.sym("none", 0)
    power = wheel.function("electrical_power")
    states = ca.reshape(x, nx, n)

    def powers(points: Array) -> Any:
        at = states @ ca.DM(lagrange_matrix(SCHEME.nodes, points)).T
        return ca.vertcat(*(power(column, u, none) for column in ca.horzsplit(at)))

    if regeneration:
        mean = ca.dot(powers(SCHEME.nodes), ca.DM(SCHEME.quadrature))
        below = ca.SX(0, 1)
    else:
        mean = ca.dot(s, ca.DM(WEIGHTS))
        below = s - powers(POWER_AT)
    equations = element(phase, SCHEME, 0)
    phi = states[STATES.index("phi"), :] @ ca.DM(lagrange_matrix(SCHEME.nodes, GUARDED_AT)).T

    def function(name: str, length: Any, inputs: Any, data: Any, *more: Any) -> ca.Function:
        outputs, _ = equations(ca.vertcat(x, u, hold * length), 1.0)
        outputs = ca.densify(ca.vertcat(outputs, below, *more))
        return ca.Function(name, [inputs, data], [outputs, hold * length * mean])

    before, after = ca.SX.sym("before", nx), ca.SX.sym("after", nx)
    mismatch = after - wheel.function("touchdown")(before, none)
    landing = ca.vertcat(mismatch, phase.at_end.function(before, none))
    places = len(path_nodes(SCHEME))
    defects = np.zeros(nx * DEGREE)
    lower, upper = (np.tile(side, places) for side in (phase.path.lower, phase.path.upper))
    lower = np.concatenate([defects, lower, np.zeros(slacks)])
    upper = np.concatenate([defects, upper, np.full(slacks, np.inf)])
    margin, apart = GRAZE * hold**2, np.ones(len(GUARDED_AT))
    share_of = data[0] + data[1] * share
    return IntervalEquations(
        phase=phase,
        whole=function("whole", 1.0, ca.vertcat(x, u, s), none, phi.T),
        part=function("part", share_of, ca.vertcat(x, u, s, share), data),
        touchdown=ca.Function("touchdown", [ca.vertcat(before, after), none], [landing, ca.SX(0)]),
        slacks=slacks,
        whole_bounds=(
            np.concatenate([lower, (c.a + margin) * apart]),
            np.concatenate([upper, (c.b - margin) * apart]),
        ),
        part_bounds=(lower, upper),
        touchdown_bounds=(
            np.concatenate([np.zeros(nx), phase.at_end.lower]),
            np.concatenate([np.zeros(nx), phase.at_end.upper]),
        ),
    )
