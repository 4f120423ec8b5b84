"""The stepping kernel against the reference simulator."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from rimless_gym import WheelParams, hybrid, simulate
from rimless_gym.energy import ROW, Ledger
from rimless_gym.equations import MODE_NAMES
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.attempt import MAX_POLE_STEP, MAX_RATE_STEP
from rimless_gym.kernel.integration import smooth_states
from rimless_gym.kernel.stepping import (
    FOOT,
    MODE,
    STATE_SIZE,
    advance,
)
from rimless_gym.params import PRESETS
from rimless_gym.trajectory import Event, Trajectory
from scripts.documents.motions import CASES, Motion

Array = NDArray[np.float64]
NUDGE = 1e-13  # rad: how much the start is moved to see what the motion itself makes of it


def foot_height(params: WheelParams, phi: float, direction: int) -> float:
    """Height (m) of the foot that comes down next."""
    p, swing = params.constants, phi - direction * params.leg_angle
    return float(hybrid.hub_position(phi, p)[1] - hybrid.hub_position(swing, p)[1])


def dip(
    params: WheelParams, y: Sequence[float], u: float, duration: float, direction: int
) -> float:
    """How deep (m) the foot goes below the ground before it comes up again; 0 if it stays."""
    states = smooth_states(params, tuple(y), u, duration, 400)
    heights = np.array([foot_height(params, state[0], direction) for state in states])
    below = np.flatnonzero(heights < 0)
    back = np.flatnonzero(heights[below[0] :] > 0) if len(below) else below
    return float(-heights[below[0] : below[0] + back[0]].min()) if len(back) else 0.0


def height_at_touchdown(reference: Trajectory, event: Event, volts: Array) -> float:
    """Height (m) of the foot, by the reference, when the kernel calls this touchdown.

    The kernel's step starts from the reference's state, half the longest step before it or at the
    last event or jump of the voltage. A touchdown passed over counts as deep as its dip.
    """
    params = reference.params
    interval = max(math.ceil(event.time / CONTROL_PERIOD - 1e-9) - 1, 0)
    earlier = [other.time for other in reference.events if other.time < event.time]
    begin = max([interval * CONTROL_PERIOD, *earlier])
    rates = max(np.abs(reference.state(begin)[2:]).sum(), 1e-9)
    limit = min(CONTROL_PERIOD, MAX_POLE_STEP / params.motor_pole, MAX_RATE_STEP / rates)
    t, u = max(begin, event.time - limit / 2), volts[interval]
    start = np.zeros((1, STATE_SIZE))
    start[0, :4] = y = reference.state(t)
    duration, touchdowns = event.time - t + limit / 2, 2.0
    while touchdowns > 1:  # the first of them
        out = advance(params, start.copy(), np.array([u]), duration, pull=math.inf)[0]
        touchdowns, duration = out[ROW.touchdowns], out[ROW.touchdown_time] * (1 - 1e-12)
    if out[ROW.touchdowns] == 0:
        return dip(params, tuple(y), u, CONTROL_PERIOD, event.direction)
    t += out[ROW.touchdown_time]
    arc = next(arc for arc in reference.arcs if arc.end == event.time)
    return abs(foot_height(params, arc.dense(t)[0], event.direction))


@dataclasses.dataclass
class KernelRun:
    """A motion by the kernel: states at the ends of the control intervals, and sums of its rows."""

    states: Array
    total: Array
    residual: float  # J, the largest of one interval

    @property
    def touchdowns(self) -> int:
        """How many there were."""
        return int(self.total[ROW.touchdowns])

    def same_events(self, touchdowns: int, mode: int, foot: int) -> bool:
        """Whether another run had as many touchdowns and ended on the same feet."""
        ended = (self.states[-1, MODE], self.states[-1, FOOT])
        return self.touchdowns == touchdowns and ended == (mode, foot)


def by_kernel(motion: Motion, moved: float = 0.0) -> KernelRun:
    """The motion by the kernel, from a start with the leg moved (rad)."""
    state, states, rows = motion.start[None].copy(), [], []
    state[0, 0] += moved
    for u in motion.volts:
        rows.append(advance(motion.params, state, np.array([u]), pull=math.inf)[0])
        states.append(state[0].copy())
    residual = max(abs(Ledger.from_rows(out, motion.params).residual) for out in rows)
    return KernelRun(np.array(states), np.sum(rows, axis=0), residual)


@dataclasses.dataclass
class Accuracy:
    """Worst disagreement of the kernel with the reference simulator over some motions.

    States and energies are compared where both see the same touchdowns and lift-offs.
    """

    motions: int = 0
    touchdowns: int = 0
    lift_offs: int = 0
    state: float = 0.0  # rad, rad/s
    nudged: float = 0.0  # rad, rad/s: the kernel's own states from a start moved by NUDGE
    height: float = 0.0  # m
    energy: float = 0.0  # J
    residual: float = 0.0  # J, of the energy balance of one control interval
    disagreements: int = 0  # motions with another number of events, or another mode or foot

    def add(self, motion: Motion) -> None:
        """Compare on one more motion."""
        ours, moved = by_kernel(motion), by_kernel(motion, NUDGE)
        ends = CONTROL_PERIOD * np.arange(1, len(motion.volts) + 1)
        reference = simulate(motion.params, motion.start[:4], motion.volts, ends[-1])
        theirs = reference.touchdowns
        self.motions += 1
        self.touchdowns += ours.touchdowns
        self.lift_offs += sum(event.kind == "lift_off" for event in reference.events)
        self.residual = max(self.residual, ours.residual)
        heights = [height_at_touchdown(reference, event, motion.volts) for event in theirs]
        mode = MODE_NAMES.index(reference.final_mode)
        if ours.same_events(len(theirs), mode, int(reference.foot[-1])):
            errors = np.abs(ours.states[:, :4] - reference.state(ends, side="left"))
            self.state = max(self.state, float(errors.max()))
            energies = [
                dataclasses.astuple(ledger)
                for ledger in (Ledger.from_rows(ours.total, motion.params), reference.ledger)
            ]
            self.energy = max(self.energy, float(np.abs(np.subtract(*energies)).max()))
        else:
            self.disagreements += 1
        if ours.same_events(moved.touchdowns, *moved.states[-1, MODE:]):
            apart = np.abs(ours.states[:, :4] - moved.states[:, :4])
            self.nudged = max(self.nudged, float(apart.max()))
        self.height = max([self.height, *heights])


def motions(name: str, case: str, count: int) -> Iterator[Motion]:
    """The first of the preset's motions of a kind."""
    rng = np.random.default_rng(11)
    for _ in range(count):
        yield CASES[case](name, rng)


def measured(name: str, case: str, count: int) -> Accuracy:
    """Accuracy on the first motions of a kind."""
    result = Accuracy()
    for motion in motions(name, case, count):
        result.add(motion)
    return result


def accuracy(count: int, grazes: int) -> dict[str, dict[str, Any]]:
    """`Accuracy` of each preset and kind of motion."""
    table: dict[str, dict[str, Any]] = {}
    for name in tqdm(PRESETS, desc="accuracy", file=sys.stderr):
        table[name] = {}
        for case in tqdm(CASES, desc=name, file=sys.stderr, leave=False):
            result = measured(name, case, grazes if "graze" in case else count)
            table[name][case] = dataclasses.asdict(result)
    return table


def missed_dips(count: int) -> dict[str, dict[str, float]]:
    """Control intervals that start near a guard, against the same in eight parts.

    Where the leg turns twice inside an interval it may dip below the ground and come back.
    """
    table = {}
    for name, params in PRESETS.items():
        p, rng = params.constants, np.random.default_rng(0)
        start = np.zeros((count, STATE_SIZE))
        start[:, 0] = p.a + 10 ** rng.uniform(-7, -2.5, count)
        start[:, 1] = rng.uniform(-math.pi, math.pi, count)
        start[:, 2] = -(10 ** rng.uniform(-4, -0.3, count)) * rng.choice([1, 1, -1], count)
        start[:, 3] = rng.uniform(-15, 15, count)
        volts, whole, parts = rng.uniform(-20, 20, count), start.copy(), start.copy()
        rows = advance(params, whole, volts, pull=math.inf)
        eighths = [advance(params, parts, volts, CONTROL_PERIOD / 8, math.inf) for _ in range(8)]
        counts = np.sum([eighth[:, ROW.touchdowns] for eighth in eighths], axis=0)
        unlike = np.flatnonzero(
            (np.abs(whole - parts).max(1) > 1e-6) | (rows[:, ROW.touchdowns] != counts)
        )
        depths = [dip(params, start[i, :4].tolist(), volts[i], CONTROL_PERIOD, -1) for i in unlike]
        table[name] = {
            "intervals": count,
            "touchdowns": int(rows[:, ROW.touchdowns].sum()),
            "unlike": len(unlike),
            "deepest": max(depths, default=0.0),
        }
    return table
