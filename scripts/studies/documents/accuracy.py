"""The stepping kernel compared with the reference simulator."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from rimless_gym import simulate
from rimless_gym.energy import ROW, Ledger
from rimless_gym.equations import MODE_NAMES
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import FOOT, MODE, advance
from rimless_gym.presets import PRESETS
from scripts.studies.documents.feet import height_at_touchdown
from scripts.studies.documents.motions import CASES, Motion

Array = NDArray[np.float64]
NUDGE = 1e-13  # rad: how far a start is moved, to see how much the motion itself magnifies it


@dataclasses.dataclass
class KernelRun:
    """A motion as the kernel computes it.

    Attributes:
        states: hybrid states at the ends of the control intervals, (N, STATE_SIZE).
        total: sums over the intervals of the rows of `rimless_gym.energy`.
        residual: the largest residual of one interval's ledger (J).
    """

    states: Array
    total: Array
    residual: float

    @property
    def touchdowns(self) -> int:
        """How many there were in all."""
        return int(self.total[ROW.touchdowns])

    def same_events(self, touchdowns: int, mode: int, foot: int) -> bool:
        """Whether this run had as many touchdowns and ended in the same mode on the same foot."""
        ended = (self.states[-1, MODE], self.states[-1, FOOT])
        return self.touchdowns == touchdowns and ended == (mode, foot)


def by_kernel(motion: Motion, moved: float = 0.0) -> KernelRun:
    """The motion as the kernel computes it, from a start whose leg is moved by `moved` (rad)."""
    state, states, rows = motion.start[None].copy(), [], []
    state[0, 0] += moved
    for u in motion.volts:
        rows.append(advance(motion.params, state, np.array([u]), pull=math.inf)[0])
        states.append(state[0].copy())
    residual = max(abs(Ledger.from_rows(out, motion.params).residual) for out in rows)
    return KernelRun(np.array(states), np.sum(rows, axis=0), residual)


@dataclasses.dataclass
class Accuracy:
    """The kernel's worst disagreement with the reference simulator over some motions.

    States and energies are compared where both have the same touchdowns and lift-offs.

    Attributes:
        motions: how many were compared.
        touchdowns: in all motions, as the kernel counts them.
        lift_offs: in all motions, as the reference counts them.
        state: largest difference between states (rad, rad/s).
        nudged: largest difference between the kernel's own states from a start and from the same
            start moved by `NUDGE` (rad, rad/s).
        height: largest height of a foot, by the reference, at a touchdown of the kernel (m).
        energy: largest difference between energies (J).
        residual: largest residual of the ledger of one control interval (J).
        disagreements: motions with different numbers of events, or a different last mode or foot.
    """

    motions: int = 0
    touchdowns: int = 0
    lift_offs: int = 0
    state: float = 0.0
    nudged: float = 0.0
    height: float = 0.0
    energy: float = 0.0
    residual: float = 0.0
    disagreements: int = 0

    def add(self, motion: Motion) -> None:
        """Compare one more motion."""
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
            energies = Ledger.from_rows(ours.total, motion.params).to_dict()
            known = reference.ledger.to_dict()
            apart = [abs(energies[name] - known[name]) for name in known if name != "residual"]
            self.energy = max(self.energy, *apart)
        else:
            self.disagreements += 1
        if ours.same_events(moved.touchdowns, *moved.states[-1, MODE:]):
            errors = np.abs(ours.states[:, :4] - moved.states[:, :4])
            self.nudged = max(self.nudged, float(errors.max()))
        self.height = max([self.height, *heights])


def motions(name: str, case: str, count: int) -> Iterator[Motion]:
    """The first `count` motions of a kind, of a preset."""
    rng = np.random.default_rng(11)
    for _ in range(count):
        yield CASES[case](name, rng)


def measured(name: str, case: str, count: int) -> Accuracy:
    """Accuracy over the first `count` motions of a kind."""
    result = Accuracy()
    for motion in motions(name, case, count):
        result.add(motion)
    return result


def accuracy(count: int, grazes: int) -> dict[str, dict[str, Any]]:
    """`Accuracy` of each preset and kind of motion.

    Args:
        count: motions of each kind.
        grazes: motions of each kind in which a foot only just touches, or misses, the ground.
    """
    table: dict[str, dict[str, Any]] = {}
    for name in tqdm(PRESETS, desc="accuracy", file=sys.stderr):
        table[name] = {}
        for case in tqdm(CASES, desc=name, file=sys.stderr, leave=False):
            result = measured(name, case, grazes if "graze" in case else count)
            table[name][case] = dataclasses.asdict(result)
    return table
