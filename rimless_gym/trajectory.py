"""What a simulation returns: dense states, events, the energy ledger and the contact forces."""

from __future__ import annotations

import bisect
import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rimless_gym.checks import real_array
from rimless_gym.energy import Ledger
from rimless_gym.equations import DOUBLE, MODE_NAMES
from rimless_gym.hybrid import MAX_RATE
from rimless_gym.params import WheelParams
from rimless_gym.rules import exceeds

#: Largest |theta| (rad) of a start. Angles of that size are rounded to 1e-11 rad.
MAX_TURNED = 1e5


@dataclasses.dataclass(frozen=True)
class Event:
    """A touchdown, lift-off or loss of contact.

    Attributes:
        kind: "touchdown", "lift_off" or "contact_lost".
        time: s.
        direction: +1 forward, -1 backward, 0 where it has no meaning.
        before: state (4,) before it.
        after: state (4,) after it.
        mode: stance mode after it, a name in `equations.MODE_NAMES`.
        loss: energy lost (J).
        impulse: (x, y) impulse of the ground (N s).
    """

    kind: str
    time: float
    direction: int
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    mode: str
    loss: float = 0.0
    impulse: tuple[float, float] = (0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Arc:
    """A smooth piece of motion over [start, end] in one mode; `dense(t)` interpolates it."""

    start: float
    end: float
    mode: int
    foot: int
    dense: Callable[[Any], NDArray[np.float64]]


@dataclasses.dataclass(frozen=True, repr=False)
class Trajectory:
    """A simulated motion.

    Attributes:
        params: the machine.
        t: times at which `x` is sampled (s), shape (N,); an event's time appears twice.
        x: states (phi, theta, phi', theta'), shape (N, 4).
        mode: stance mode per sample, shape (N,), 0 single and 1 double.
        foot: stance foot per sample, counted in legs forward of the first, shape (N,).
        u: voltage per sample (V), shape (N,).
        events: in order of time.
        ledger: the energies of the whole motion.
        min_normal_force: smallest Fy (N).
        friction_demand: largest |Fx|/Fy in stance (infinite where Fy <= 0).
        impulse_friction_demand: the same for the impulses of touchdowns, 0 if there are none.
        clearance: smallest height of the pendulum's end above the ground (m).
        failure: None, or why it ended early: the name of a `hybrid.Failure`, in lower case.
    """

    params: WheelParams
    t: NDArray[np.float64]
    x: NDArray[np.float64]
    mode: NDArray[np.int64]
    foot: NDArray[np.int64]
    u: NDArray[np.float64]
    events: Sequence[Event]
    arcs: Sequence[Arc]
    ledger: Ledger
    min_normal_force: float
    friction_demand: float
    impulse_friction_demand: float
    clearance: float
    failure: str | None

    def __repr__(self) -> str:
        ending = self.failure or self.final_mode
        return (
            f"Trajectory({self.t[-1]:.4g} s, {self.steps} steps, {len(self.events)} events, "
            f"{ending})"
        )

    @property
    def steps(self) -> int:
        """Legs by which the stance foot has moved forward: forward minus backward touchdowns."""
        return int(self.foot[-1])

    @property
    def touchdowns(self) -> list[Event]:
        """The touchdowns among the events."""
        return [event for event in self.events if event.kind == "touchdown"]

    @property
    def slips(self) -> bool:
        """Whether the foot ever needs more friction than `params.friction` offers."""
        demand = max(self.friction_demand, self.impulse_friction_demand)
        return bool(exceeds(demand, self.params.friction))

    @property
    def final_mode(self) -> str:
        """Stance mode at the end."""
        return MODE_NAMES[int(self.mode[-1])]

    def state(self, t: ArrayLike, side: str = "right") -> NDArray[np.float64]:
        """State at time t (s): (4,) for a scalar, (N, 4) for N times.

        At the time of an event it is the state after it, or with ``side="left"`` the one before.

        Raises:
            ValueError: a time lies outside the simulated interval.
        """
        times = np.atleast_1d(np.asarray(t, dtype=np.float64))
        first, last = self.arcs[0].start, self.arcs[-1].end
        if not np.all((times >= first - 1e-12) & (times <= last + 1e-12)):
            raise ValueError(f"t = {t!r}: outside the simulated interval [{first}, {last}] s")
        starts = [arc.start for arc in self.arcs]
        find = bisect.bisect_right if side == "right" else bisect.bisect_left
        states = np.empty((len(times), 4))
        for i, time in enumerate(times):
            arc = self.arcs[max(find(starts, time) - 1, 0)]
            states[i] = arc.dense(min(max(time, arc.start), arc.end))[:4]
            if arc.mode == DOUBLE:
                states[i, 2] = 0.0
        return states if np.ndim(t) else states[0]


def validated_start(
    params: WheelParams, x0: ArrayLike, mode: str, name: str = "x0"
) -> tuple[NDArray[np.float64], int]:
    """A start (phi, theta, phi', theta') as an array (4,), and the index of its stance mode.

    Errors call it `name`.
    """
    x = real_array(name, x0).astype(np.float64)
    if x.shape != (4,) or not np.all(np.isfinite(x)):
        raise ValueError(f"{name} = {x0!r}: must be four finite numbers (phi, theta, phi', theta')")
    if mode not in MODE_NAMES:
        raise ValueError(f"mode = {mode!r}: choose from {MODE_NAMES}")
    if abs(x[1]) > MAX_TURNED:
        raise ValueError(
            f"theta = {x[1]}: must be within {MAX_TURNED:g} rad of 0, beyond which rounding blurs "
            "it; give it modulo 2 pi"
        )
    a, b = params.constants.a, params.constants.b
    if not a - 1e-9 <= x[0] <= b + 1e-9:
        raise ValueError(f"phi = {x[0]}: a foot is on the ground only for phi in [{a}, {b}] rad")
    if mode == "double_stance" and (abs(x[0] - a) > 1e-9 or x[2] != 0):
        raise ValueError(f"{name} = {x0!r}: double stance has phi = {a} (leading leg) and phi' = 0")
    if max(abs(x[2]), abs(x[3])) > MAX_RATE:
        raise ValueError(f"{name} = {x0!r}: rates must not exceed {MAX_RATE} rad/s")
    return x, MODE_NAMES.index(mode)
