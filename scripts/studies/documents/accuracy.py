"""The stepping kernel compared with the reference simulator."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from rimless_gym import WheelParams, simulate
from rimless_gym.energy import ROW, Ledger
from rimless_gym.equations import MODE_NAMES, SINGLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.integration import smooth_states
from rimless_gym.kernel.stepping import DPHI, DTHETA, FOOT, MODE, THETA, advance
from rimless_gym.presets import PRESETS

Array = NDArray[np.float64]
NUDGE = 1e-13  # rad: how far a start is moved, to see how much the motion itself magnifies it


@dataclasses.dataclass
class KernelRun:
    """A motion as the kernel computes it."""

    states: Array  # hybrid states at the ends of the control intervals, (N, STATE_SIZE)
    total: Array  # sums over the intervals of the rows of `rimless_gym.energy`
    residual: float  # the largest residual of one interval's ledger (J)

    @property
    def events(self) -> tuple[int, int, int]:
        """How many touchdowns there were, and the mode and foot at the end."""
        mode, foot = self.states[-1, [MODE, FOOT]].astype(int)
        return int(self.total[ROW.touchdowns]), int(mode), int(foot)


def by_kernel(motion: DrivenMotion, moved: float = 0.0) -> KernelRun:
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
    """

    motions: int = 0  # how many were compared
    touchdowns: int = 0  # in all motions, as the kernel counts them
    state: float = 0.0  # largest difference between states (rad, rad/s)
    # largest difference between the kernel's own states from a start and from the same start moved
    # by `NUDGE` (rad, rad/s)
    nudged: float = 0.0
    energy: float = 0.0  # largest difference between energies (J)
    residual: float = 0.0  # largest residual of the ledger of one control interval (J)
    # motions with different numbers of events, or a different last mode or foot
    disagreements: int = 0

    def add(self, motion: DrivenMotion) -> None:
        """Compare one more motion."""
        ours, moved = by_kernel(motion), by_kernel(motion, NUDGE)
        ends = CONTROL_PERIOD * np.arange(1, len(motion.volts) + 1)
        reference = simulate(motion.params, motion.start[:4], motion.volts, ends[-1])
        self.motions += 1
        self.touchdowns += ours.events[0]
        self.residual = max(self.residual, ours.residual)
        mode = MODE_NAMES.index(reference.final_mode)
        if ours.events == (len(reference.touchdowns), mode, int(reference.foot[-1])):
            errors = np.abs(ours.states[:, :4] - reference.state(ends, side="left"))
            self.state = max(self.state, float(errors.max()))
            energies = Ledger.from_rows(ours.total, motion.params).to_dict()
            known = reference.ledger.to_dict()
            apart = [abs(energies[name] - known[name]) for name in known if name != "residual"]
            self.energy = max(self.energy, *apart)
        else:
            self.disagreements += 1
        if ours.events == moved.events:
            errors = np.abs(ours.states[:, :4] - moved.states[:, :4])
            self.nudged = max(self.nudged, float(errors.max()))


def measured(name: str, case: str, count: int) -> Accuracy:
    """Accuracy over the first `count` motions of a kind, of a preset."""
    result, rng = Accuracy(), np.random.default_rng(11)
    for _ in range(count):
        result.add(CASES[case](name, rng))
    return result


def accuracy(count: int, grazes: int) -> dict[str, dict[str, Any]]:
    """`Accuracy` of each preset and kind of motion."""
    table: dict[str, dict[str, Any]] = {}
    for name in tqdm(PRESETS, desc="accuracy", file=sys.stderr):
        table[name] = {}
        for case in tqdm(CASES, desc=name, file=sys.stderr, leave=False):
            result = measured(name, case, grazes if case == "graze" else count)
            table[name][case] = dataclasses.asdict(result)
    return table


@dataclasses.dataclass(frozen=True)
class DrivenMotion:
    """A motion to simulate."""

    params: WheelParams  # the machine
    start: Array  # hybrid state (STATE_SIZE,)
    volts: Array  # voltages (V), each held for one control interval


def hybrid_state(phi: float, theta: float, dphi: float, dtheta: float, mode: int = SINGLE) -> Array:
    """A state of the stepping kernel, on the first foot."""
    return np.array([phi, theta, dphi, dtheta, mode, 0.0])


def walking(name: str, rng: np.random.Generator) -> DrivenMotion:
    """The pendulum is held ahead of the hub. Machines with too weak a motor walk downhill."""
    slope = {"THESIS_NOMINAL": 0.1, "PROTOTYPE": 0.45}.get(name, 0.0)
    params, lean = PRESETS[name].replace(slope=slope), rng.uniform(1.0, 1.4)
    start = hybrid_state(params.constants.a, lean, rng.uniform(1.5, 2.5), 0.0)
    state, volts = start[None].copy(), []
    for _ in range(150):
        push = 30 * (lean - state[0, THETA]) - 3 * state[0, DTHETA] + 3 * state[0, DPHI] + 10
        volts.append(np.clip(push, -params.voltage_limit, params.voltage_limit))
        advance(params, state, np.array(volts[-1:]), pull=math.inf)
    return DrivenMotion(params, start, np.array(volts))


def falling_back(name: str, rng: np.random.Generator) -> DrivenMotion:
    """The wheel falls backward from mid-stance, under random voltages."""
    params = PRESETS[name]
    start = hybrid_state(rng.uniform(1.2, 1.8), rng.uniform(-1, 1), rng.uniform(-4, -2), 0.0)
    return DrivenMotion(params, start, rng.uniform(-8, 8, 80))


def rocking(name: str, rng: np.random.Generator) -> DrivenMotion:
    """The wheel rocks on two feet under an alternating voltage."""
    params = PRESETS[name]
    volts = params.voltage_limit * np.sin(
        rng.uniform(5, 9) * CONTROL_PERIOD * np.arange(150) + rng.uniform(0, 6)
    )
    start = hybrid_state(params.constants.a + 0.02, rng.uniform(-1.5, 1.5), 0.0, 0.0)
    return DrivenMotion(params, start, volts)


def resting(name: str, rng: np.random.Generator) -> DrivenMotion:
    """The wheel comes to rest on two feet; then full voltage makes it lift off again."""
    params = PRESETS[name]
    start = hybrid_state(
        params.constants.a + rng.uniform(0.01, 0.05), rng.uniform(-0.3, 0.3), 0.0, 0.0
    )
    sign = rng.choice([-1.0, 1.0])
    return DrivenMotion(
        params, start, np.where(np.arange(150) < 100, 0.0, sign * params.voltage_limit)
    )


def several_touchdowns(name: str, rng: np.random.Generator) -> DrivenMotion:
    """Nearly at rest, with three or more touchdowns in the first control interval."""
    params, p = PRESETS[name], PRESETS[name].constants
    while True:
        start = hybrid_state(p.a, rng.uniform(-0.5, 0.5), rng.uniform(0.002, 0.04), 0.0)
        motion = DrivenMotion(params, start, rng.uniform(-1, 1, 2))
        rows = advance(params, start[None].copy(), motion.volts[:1], pull=math.inf)
        if rows[0, ROW.touchdowns] >= 3:
            return motion


#: How far below the ground the swing foot of a graze turns back (m).
GRAZE = 1e-11


def graze(name: str, rng: np.random.Generator) -> DrivenMotion:
    """The leg turns back when the swing foot is `GRAZE` below the ground.

    The turning point is drawn. Integrating backward from it gives the start, 3 to 7 ms earlier.
    """
    params, p = PRESETS[name], PRESETS[name].constants
    forward = bool(rng.integers(2))
    phi = p.b + GRAZE / params.step_length if forward else p.a - GRAZE / params.step_length
    while True:
        theta, dtheta = rng.uniform(-math.pi, math.pi), rng.uniform(-8, 8)
        u = rng.uniform(-params.voltage_limit, params.voltage_limit)
        before = -rng.uniform(0.003, 0.007)
        *_, y = smooth_states(params, (phi, theta, 0.0, dtheta), u, before, 32)
        turns_back = (y[2] > 0) == forward and abs(y[2]) > 1e-3
        if p.a < y[0] < p.b and turns_back and abs(y[3]) < 40:
            return DrivenMotion(params, hybrid_state(y[0], y[1], y[2], y[3]), np.array([u]))


CASES: dict[str, Callable[[str, np.random.Generator], DrivenMotion]] = {
    "walking": walking,
    "falling back": falling_back,
    "rocking": rocking,
    "resting, lift-off": resting,
    "several touchdowns": several_touchdowns,
    "graze": graze,
}
