"""The periodic gait of least cost under a held voltage, from a gait with a continuous one.

The optimum of the program (`held_program`) is stepped on the kernel as the environment steps it,
made to repeat itself there, and verified by both simulators.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import bmat, eye
from scipy.sparse.linalg import spsolve

from rimless_gym.energy import ROW, Ledger
from rimless_gym.hybrid import CONTROL_PERIOD, Failure
from rimless_gym.kernel.stepping import STATE_SIZE, advance
from rimless_gym.params import WheelParams
from rimless_gym.reference import simulate
from rimless_gym.trajectory import Trajectory
from trajopt.gaits.held_program import HeldOptimum, HeldProgram
from trajopt.gaits.held_stride import HeldStride
from trajopt.gaits.solution import Optimality, Solution
from trajopt.gaits.verify import (
    AUDIT_TOLERANCE,
    STATE_TOLERANCE,
    Verification,
    simulated,
    verify,
)
from trajopt.ocp.arrays import Array
from trajopt.ocp.schemes import radau_nodes
from trajopt.ocp.trajectory import PhaseTrajectory
from trajopt.store import provenance

#: Phases of the clock to start from, one after the other until there is an optimum: how much
#: of its interval lies before the first touchdown. All give about the same one, in which the
#: touchdowns come with the ticks: there the voltage of an optimum jumps.
SHARES = (0.02, 0.5, 0.98)

#: IPOPT's first barrier, and its iterations.
BARRIER, ITERATIONS = 1e-4, 300

#: By what fraction a neighbouring pattern must cost less, and how many are followed.
WORTHWHILE, MOST_MOVES = 1e-5, 10

#: Of the central differences (rad, rad/s).
DIFFERENCE = 1e-7

#: Newton steps at most, and the mismatch (rad, rad/s) at which they end.
NEWTON_STEPS, SMALL = 12, 1e-13

#: Nodes of the states within an interval: enough for intervals of 20 ms and more.
NODES: Array = radau_nodes(12)

#: Where in its interval the one value of a held voltage is kept.
MIDDLE: Array = np.array([0.5])

#: Largest residual of the kernel's ledger over a stride (J).
LEDGER_TOLERANCE = 1e-9

#: By what fraction the simulators' E+ may differ. An optimal voltage is held such that the current
#: just reaches zero within an interval, where the kernel finds the zero to fewer digits.
SAME_ENERGY = 1e-4


def held_gait(
    gait: Solution,
    hold: float,
    ticks: int,
    regeneration: bool,
    settings: Mapping[str, object],
) -> tuple[Solution | None, list[str]]:
    """The held gait that the optimisation finds near another gait, verified; or None, and why.

    Args:
        gait: of the same machine and number of steps, of about as many intervals.
        hold: s.
        ticks: intervals per stride.
        regeneration: whether the battery takes energy back.
        settings: of the search, for the provenance.
    """
    search = _HeldSearch(gait.params, gait.theta_turns, regeneration)
    for share in SHARES:
        search.solve(HeldStride.from_gait(gait, hold, ticks, share))
        if search.solved:
            break
    search.descend()
    if search.best is None:
        return None, search.failures
    return _finished(search, settings)


class _HeldSearch:
    """Local optima of one stride, and where their touchdowns fall.

    Attributes:
        solved: the local optima.
        failures: why others were not found.
    """

    def __init__(self, params: WheelParams, turns: int, regeneration: bool) -> None:
        self.params, self.turns, self.regeneration = params, turns, regeneration
        self.solved: list[HeldOptimum] = []
        self.failures: list[str] = []

    @property
    def best(self) -> HeldOptimum | None:
        """The optimum that costs least."""
        return min(self.solved, key=lambda optimum: optimum.energy, default=None)

    def solve(self, guess: HeldStride) -> None:
        """Look for an optimum near a guess."""
        program = HeldProgram(self.params, guess.pattern, self.turns, self.regeneration)
        optimum = program.solve(guess, mu_init=BARRIER, max_iter=ITERATIONS)
        if optimum.success:
            self.solved.append(optimum)
        else:
            self.failures.append("no gait was found nearby with the voltage held")

    def descend(self) -> None:
        """Move single touchdowns by an interval for as long as that saves energy."""
        tried = {optimum.stride.step_ticks for optimum in self.solved}
        for _ in range(MOST_MOVES):
            best = self.best
            if best is None:
                return
            for guess in best.stride.neighbours():
                if guess.step_ticks not in tried:
                    tried.add(guess.step_ticks)
                    self.solve(guess)
            least = self.best
            if least is None or least.energy > best.energy - WORTHWHILE * abs(best.energy):
                return


def _finished(
    search: _HeldSearch, settings: Mapping[str, object]
) -> tuple[Solution | None, list[str]]:
    """The best optimum as a gait: its states those of the kernel, verified."""
    assert search.best is not None
    stride, params = search.best.stride, search.params
    hold = stride.pattern.hold
    volts = representable(np.roll(stride.voltages, -1), params.voltage_limit)
    held = HeldVoltages(params, hold, volts, search.turns)
    near = np.concatenate([phase.states[1:, 0] for phase in stride.phases])
    states = repeating(held, near)
    replay = replayed(held, states[0])
    obstacle = _obstacle(replay, stride)
    if obstacle:
        return None, [*search.failures, obstacle]
    phases = recorded(held, replay)
    error = np.abs(states - near).max() / (1.0 + np.abs(near).max())
    gait = Solution(
        params=params,
        phases=phases,
        theta_turns=search.turns,
        regeneration=search.regeneration,
        verification=verified(held, replay, phases),
        optimality=Optimality(float(error), math.nan, math.nan),
        provenance=provenance(**settings),
        hold=hold,
    )
    return gait, search.failures


def representable(voltages: Array, limit: float) -> Array:
    """The nearest voltages that are a float32 share of the limit, as the environment's actions."""
    return np.asarray(limit * np.float32(voltages / limit).astype(np.float64))


def _obstacle(replay: SteppedStride, stride: HeldStride) -> str:
    """Why a stride on the kernel is not the one that was optimised; empty if it is."""
    if replay.failure != Failure.NONE:
        return f"{replay.failure.name.lower()} on the kernel"
    apart = (replay.touchdown_times >= 0.0).sum() == replay.touchdowns == stride.pattern.steps
    if not apart or replay.touchdown_times[-1] < 0.0:
        return f"{replay.touchdowns} touchdowns on the kernel, not {stride.pattern.steps}"
    return ""


# -- a stride on the kernel, interval by interval, as the environment steps it --------------------


class HeldVoltages(NamedTuple):
    """A stride under a clock."""

    params: WheelParams  # the machine
    hold: float  # s
    voltages: Array  # of the intervals from one tick to the next (V), shape (ticks,)
    theta_turns: int  # whole turns that theta gains

    @property
    def shift(self) -> Array:
        """By how much the state at the end differs from that at the start, shape (4,)."""
        return np.array([0.0, 2 * math.pi * self.theta_turns, 0.0, 0.0])


@dataclasses.dataclass(frozen=True)
class SteppedStride:
    """A stride on the kernel."""

    states: Array  # at the ticks, before any interval and after all, shape (ticks + 1, 4)
    # of the last touchdown in each interval, from its start (s), or -1, shape (ticks,)
    touchdown_times: Array
    touchdowns: int  # how many in all
    ledger: Ledger  # of all intervals
    failure: Failure  # of the interval that ended early, or `Failure.NONE`


def replayed(held: HeldVoltages, start: Array) -> SteppedStride:
    """A stride from a state (4,) at a tick, in single stance."""
    state = _at(start[None])
    states, rows = [start], []
    for volts in held.voltages:
        rows.append(_advance(held.params, state, np.array([volts]), held.hold)[0])
        states.append(state[0, :4].copy())
    table = np.array(rows)
    return SteppedStride(
        np.array(states),
        table[:, ROW.touchdown_time],
        int(table[:, ROW.touchdowns].sum()),
        Ledger.from_rows(table.sum(axis=0), held.params),
        Failure(int(table[:, ROW.failure].max())),
    )


def repeating(held: HeldVoltages, states: Array) -> Array:
    """The states at the ticks of the stride that repeats itself under the held voltages.

    Newton's method on all intervals at once. A stride magnifies deviations, so solving for its
    start alone would not converge.

    Args:
        held: the voltages.
        states: near the solution, at the ticks before each interval, shape (ticks, 4).

    Returns:
        Shape (ticks, 4); not a solution if Newton's method did not converge.
    """
    for _ in range(NEWTON_STEPS):
        ends, slopes = _ends(held, states), _slopes(held, states)
        gaps = ends - np.roll(states, -1, axis=0)
        gaps[-1] -= held.shift
        if not np.isfinite(gaps).all() or np.abs(gaps).max() < SMALL:
            break
        states = states + _corrections(slopes, gaps)
    return states


def _corrections(slopes: Array, gaps: Array) -> Array:
    """The changes dx of the states with dx of the next = slope dx + gap, cyclically."""
    n = len(gaps)
    blocks: list[list[object]] = [[None] * n for _ in range(n)]
    for k in range(n):
        blocks[k][k] = slopes[k]
        blocks[k][(k + 1) % n] = -eye(4)
    return np.asarray(spsolve(bmat(blocks, format="csc"), -gaps.ravel())).reshape(n, 4)


def _slopes(held: HeldVoltages, states: Array) -> Array:
    """Derivatives of each interval's end by its start, shape (ticks, 4, 4)."""
    columns = []
    for i in range(4):
        nudge = np.zeros(4)
        nudge[i] = DIFFERENCE
        columns.append(
            (_ends(held, states + nudge) - _ends(held, states - nudge)) / (2 * DIFFERENCE)
        )
    return np.stack(columns, axis=2)


def _ends(held: HeldVoltages, states: Array) -> Array:
    """Where each interval leads from a start of its own, shape (ticks, 4)."""
    return after(held, states, held.hold)


def after(held: HeldVoltages, states: Array, duration: float) -> Array:
    """Where each interval's voltage leads from a state at its start in a duration, (ticks, 4)."""
    batch = _at(states)
    _advance(held.params, batch, held.voltages, duration)
    return batch[:, :4].copy()


def _at(states: Array) -> Array:
    """Hybrid states in single stance on foot 0."""
    batch = np.zeros((len(states), STATE_SIZE))
    batch[:, :4] = states
    return batch


def _advance(params: WheelParams, batch: Array, voltages: Array, duration: float) -> Array:
    """Advance hybrid states in place, by the environment's intervals if it is longer; its rows."""
    pieces = max(1, math.ceil(duration / CONTROL_PERIOD - 1e-9))
    rows = [advance(params, batch, voltages, duration / pieces) for _ in range(pieces)]
    total = np.sum(rows, axis=0)
    times = np.array([row[:, ROW.touchdown_time] for row in rows])
    offsets = duration / pieces * np.arange(pieces)[:, None]
    total[:, ROW.touchdown_time] = np.where(times >= 0.0, times + offsets, -1.0).max(axis=0)
    total[:, ROW.failure] = np.max([row[:, ROW.failure] for row in rows], axis=0)
    return np.asarray(total)


# -- its phases, and its verification ------------------------------------------------------------


def recorded(held: HeldVoltages, replay: SteppedStride) -> tuple[PhaseTrajectory, ...]:
    """One phase per step, from touchdown to touchdown.

    Args:
        held: the stride's voltages, from one tick to the same tick of the next stride.
        replay: the stride from the tick after its first touchdown; its last interval has the last
            touchdown, and no interval has two.
    """
    states = _inside(held, replay.states[:-1])
    steps, phases = np.flatnonzero(replay.touchdown_times >= 0.0).tolist(), []
    landings = [_landing(held, replay.states[k], held.voltages[k]) for k in steps]
    first, shift = 0, held.shift
    for i, last in enumerate(steps):
        run = landings[i - 1]
        left = held.hold - run.touchdowns[0].time
        ahead = _after(run, held.hold) - shift  # the part of an interval before the first tick
        lengths = np.full(last - first + 2, held.hold)
        lengths[0], lengths[-1] = left, landings[i].touchdowns[0].time
        volts = held.voltages[np.arange(first - 1, last + 1)]
        phases.append(
            PhaseTrajectory(
                edges=np.concatenate([[0.0], np.cumsum(lengths)]),
                nodes=NODES,
                states=np.concatenate(
                    [ahead[None], states[first:last], _before(landings[i])[None]]
                ),
                control_nodes=MIDDLE,
                controls=volts[:, None, None],
            )
        )
        first, shift = last + 1, np.zeros(4)
    return tuple(phases)


def _inside(held: HeldVoltages, states: Array) -> Array:
    """States at the nodes of all intervals (ticks, nodes, 4); not where there is a touchdown."""
    inner = [after(held, states, s * held.hold) for s in NODES[1:]]
    return np.stack([states, *inner], axis=1)


def _landing(held: HeldVoltages, state: Array, volts: float) -> Trajectory:
    """An interval with a touchdown, by the reference simulator."""
    return simulate(held.params, state, lambda t, x: float(volts), held.hold)


def _before(run: Trajectory) -> Array:
    event = run.touchdowns[0]
    return np.vstack([run.state(NODES[:-1] * event.time), event.before])


def _after(run: Trajectory, hold: float) -> Array:
    event = run.touchdowns[0]
    left = hold - event.time
    return np.vstack([event.after, run.state(event.time + NODES[1:] * left)])


def verified(
    held: HeldVoltages, replay: SteppedStride, phases: Sequence[PhaseTrajectory]
) -> Verification:
    """Verification by the reference simulator, with the energies of the stepping kernel.

    Args:
        held: the stride under its clock.
        replay: the same on the kernel.
        phases: the same from touchdown to touchdown.
    """
    reference = verify(held.params, phases, held.theta_turns)
    ledger = replay.ledger
    repeat = float(np.abs(replay.states[-1] - replay.states[0] - held.shift).max())
    twin = simulated(held.params, phases, len(held.voltages) * held.hold).ledger
    audit = abs(twin.energy_with_regeneration - ledger.energy_with_regeneration)
    positive = abs(twin.energy - ledger.energy)
    checks = [
        (repeat <= STATE_TOLERANCE, "the kernel does not repeat the stride"),
        (abs(ledger.residual) <= LEDGER_TOLERANCE, "the kernel's ledger does not close"),
        (
            audit <= AUDIT_TOLERANCE and positive <= SAME_ENERGY * ledger.energy + AUDIT_TOLERANCE,
            "the two simulators differ in energy",
        ),
    ]
    return dataclasses.replace(
        reference,
        energy_audit=max(reference.energy_audit, audit),
        electrical_positive=ledger.energy,
        electrical=ledger.energy_with_regeneration,
        repeat_error=repeat,
        repeat_residual=abs(ledger.residual),
        failures=(*reference.failures, *(message for good, message in checks if not good)),
    )
