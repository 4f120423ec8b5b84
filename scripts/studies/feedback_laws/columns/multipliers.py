"""Floquet multipliers of the closed loop by itself, and how fast small deviations really decay.

The stride map leads from a tick of the held gait's clock to the same tick of the next stride. At
each tick the law decides anew, on the stepping kernel, without catch or guard.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from rimless_gym.energy import ROW
from rimless_gym.equations import SINGLE
from rimless_gym.kernel.stepping import advance, hybrid_states
from scripts.studies.feedback_laws.sizes import Sizes
from scripts.studies.feedback_laws.subject import Subject
from trajopt.feedback.law import Floats
from trajopt.feedback.orbit import Grid
from trajopt.gaits.solution import Solution

#: Half the distances of the central differences, in standard deviations of the gait's own motion.
#: The median of three is right even if a touchdown falls between the two sides of one of them.
DIFFERENCES = np.array([1e-4, 1e-5, 1e-6])

#: Size of the deviations whose decay is measured, in the same unit.
DEVIATION = 1e-3

#: Below this size, rounding and the fixed point's own error may count.
FLOOR = 1e-8

#: Strides over which a deviation is followed; the first ones are left out, in which directions
#: decay that are soon gone.
STRIDES, SKIPPED = 40, 2

#: Newton steps to the fixed point, and the residual at which it is found.
STEPS, FOUND = 20, 1e-9

#: Strides by which the wheel settles first, where the gait's own state is no fixed point.
SETTLING = 60

#: (states (n, 4), tick) -> volts (n,)
Volts = Callable[[Floats, int], Floats]


class Stride(NamedTuple):
    """The map from a tick to the one a stride later.

    Attributes:
        gait: the held gait.
        volts: at a tick.
        scale: of the coordinates, in which deviations are measured (standard deviations), (4,).
    """

    gait: Solution
    volts: Volts
    scale: Floats

    def __call__(self, states: Floats) -> Floats:
        """States (n, 4) a stride later; NaN where the wheel fell."""
        gait, hold = self.gait, self.gait.hold
        assert hold is not None
        x = hybrid_states(states, SINGLE)
        fell = ~np.isfinite(states).all(axis=1)
        x[fell, :4] = gait.state(gait.first_tick)
        for tick in range(round(gait.duration / hold)):
            out = advance(gait.params, x, self.volts(x[:, :4], tick), hold)
            fell |= out[:, ROW.failure] != 0.0
        x[:, 1] -= 2 * math.pi * gait.theta_turns
        x[fell] = np.nan
        return x[:, :4]

    def jacobian(self, at: Floats) -> Floats:
        """Jacobian in units of `scale`, (4, 4): the median of several central differences."""
        sizes, sides = DIFFERENCES[:, None, None, None], np.array([1.0, -1.0])[:, None, None]
        nudges = (sizes * sides * np.eye(4) * self.scale).reshape(-1, 4)
        ends = self(at + nudges).reshape(len(DIFFERENCES), 2, 4, 4)
        slopes = (ends[:, 0] - ends[:, 1]) / self.scale / (2 * sizes[:, 0])
        return np.asarray(np.median(slopes, axis=0).T)

    def residual(self, at: Floats) -> Floats:
        """How far a state is moved, in units of `scale`."""
        return np.asarray((self(at[None])[0] - at) / self.scale)


def multipliers(subject: Subject, sizes: Sizes) -> dict[str, Any]:
    """Absolute values, largest first; None where the law by itself has no steady gait."""
    gait, law = subject.gait, subject.law
    scale = 1.0 / np.sqrt(Grid.of(gait).metric)
    played = gait.held_voltages
    opened = Stride(gait, lambda x, tick: np.full(len(x), played[tick]), scale)
    closed = Stride(gait, lambda x, tick: law(x, SINGLE), scale)
    on = np.asarray(gait.state(gait.first_tick))
    found: dict[str, Any] = {"open_loop": _sizes(opened.jacobian(on)), "closed_loop": None}
    found |= {"touchdowns_switch": [float(abs(m)) for m in gait.floquet], "decay": None}
    at = fixed_point(closed, on)
    if at is not None:
        found["closed_loop"] = _sizes(closed.jacobian(at))
        found["beside_the_gait"] = float(np.linalg.norm((at - on) / scale))
        found["decay"] = decay(closed, at, sizes.deviations)
    return found


def _sizes(jacobian: Floats) -> list[float] | None:
    if not np.isfinite(jacobian).all():
        return None
    return sorted((float(m) for m in np.abs(np.linalg.eigvals(jacobian))), reverse=True)


def fixed_point(stride: Stride, near: Floats) -> Floats | None:
    """A state that the stride map leaves where it is; None if none is found."""
    for settling in (0, SETTLING):
        at = near
        for _ in range(settling):
            at = stride(at[None])[0]
        for _ in range(STEPS):
            residual = stride.residual(at)
            if not np.isfinite(residual).all():
                break
            if np.linalg.norm(residual) < FOUND:
                return at
            jacobian = stride.jacobian(at)
            if not np.isfinite(jacobian).all():
                break
            step = np.linalg.lstsq(np.eye(4) - jacobian, residual, rcond=1e-6)[0]
            at = at + stride.scale * step
    return None


def decay(stride: Stride, at: Floats, count: int) -> float | None:
    """The factor by which small deviations shrink in a stride; None if some wheel fell."""
    drawn = np.random.default_rng(0).normal(size=(count, 4))
    drawn *= DEVIATION / np.linalg.norm(drawn, axis=1)[:, None]
    states, logs = at + drawn * stride.scale, []
    for _ in range(STRIDES):
        sizes = np.linalg.norm((states - at) / stride.scale, axis=1)
        if not np.isfinite(sizes).all():
            return None
        typical = np.exp(np.mean(np.log(np.maximum(sizes, 1e-300))))
        if typical < FLOOR:
            break
        logs.append(math.log(typical))
        states = stride(states)
    skipped = min(SKIPPED, max(len(logs) - 2, 0))
    if len(logs) - skipped < 2:
        return None
    return math.exp(float(np.polyfit(np.arange(len(logs) - skipped), logs[skipped:], 1)[0]))
