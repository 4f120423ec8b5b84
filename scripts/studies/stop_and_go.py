"""The study `stop_and_go`: walks from rest to rest, and what they cost at slow mean speeds.

A wheel at rest on two feet, its pendulum hanging, is started and walks at 0.62 m/s.
Then its motor is short-circuited, and friction and touchdowns bring it to the state in which it
began. It may rest as long as it likes, so such a cycle has every mean speed that is slow enough.
Everything is simulated on the stepping kernel. No foot lifts or slips: where the controller's
voltage would let it, the nearest one is held that does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.cli.options import MaybePath
from agents.experts import EXPERT_SPEED
from agents.rollout import at_rest
from rimless_gym import BUILDABLE
from rimless_gym.energy import ROW
from rimless_gym.equations import DOUBLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import DTHETA, FOOT, MODE, THETA, advance
from rimless_gym.params import WheelParams
from rimless_gym.rules import exceeds
from scripts.studies.documents.markdown import marks, refresh, table
from scripts.studies.fronts.command import hull
from trajopt import periodic_gait
from trajopt.feedback import laws
from trajopt.feedback.controller import NEAR, ContactGuard, SwitchingController, margin_for
from trajopt.feedback.law import Floats
from trajopt.feedback.startup import Weights, startup_for
from trajopt.gaits.fronts import shipped_front
from trajopt.gaits.solution import Solution

#: Steps after which the wheel is stopped, and mean speeds (m/s) of the table.
STEPS, SPEEDS = (20, 40, 80, 160, 320), (0.1, 0.15, 0.2, 0.25, 0.3, 0.35)

#: Weights of the start-up controller. A start may take its time, since the wheel draws its idle
#: power at rest as well.
TIME, DISTANCE = 0.01, 0.02

#: Voltages, as shares of the limit, that are tried where a foot would lift or slip.
SHARES = np.linspace(-1.0, 1.0, 49)

#: Touchdowns that lose less than this (J) in a control period do not count as slips: a wheel comes
#: to rest by ever smaller ones, of which the last stops it on two feet.
SOFT = 1e-3

#: The wheel is at rest when its pendulum is within this of hanging still (rad, rad/s), and has not
#: come to rest if it takes longer than this (s).
REST, LONGEST = 1e-9, 40.0

MARKS = marks("stop_and_go", ("BUILDABLE",))


class Cycle(NamedTuple):
    """From rest to rest."""

    steps: int  # net
    moving: float  # time until the pendulum hangs still (s)
    energy: float  # drawn from the battery, without the idle power (J)


def stop_and_go(*, docs: MaybePath = None) -> int:
    """Simulate walks of BUILDABLE from rest to rest, and compare them with the front.

    Args:
        docs: docs/front.md, to write the table into.
    """
    gait = periodic_gait(BUILDABLE, EXPERT_SPEED, hold=CONTROL_PERIOD)
    text = section(cycles(gait, STEPS), BUILDABLE)
    if docs:
        refresh(docs, MARKS, {"BUILDABLE": text})
    print(text)
    return 0


def cycles(gait: Solution, counts: Sequence[int]) -> list[Cycle]:
    """The most efficient cycles that are stopped within the stride after so many steps."""
    params, stride = gait.params, np.arange(round(gait.duration / CONTROL_PERIOD))
    states, rows = walk(efficient(gait), at_rest(params), counts[-1] + gait.steps)
    energy = np.append(0.0, rows[:, ROW.electrical_positive].cumsum())
    found = []
    for count in counts:
        last = np.argmax(states[:, FOOT] >= count) + stride
        after, moving, more = stopped(params, states[last])
        spent = energy[last] + more[:, ROW.electrical_positive]
        steps, moved = after[:, FOOT].astype(int), CONTROL_PERIOD * last + moving
        cost = spent - steps * (energy[last[-1]] - energy[last[0]]) / gait.steps
        best = int(np.where(np.isfinite(moving), cost, np.inf).argmin())
        found.append(Cycle(int(steps[best]), float(moved[best]), float(spent[best])))
    return found


def efficient(gait: Solution) -> ContactGuard:
    """The LQR about a gait, with a start that takes little energy instead of little time."""
    law = laws.holding("lqr", gait)
    startup = startup_for(law, NEAR, Weights(TIME, 1.0 / gait.params.weight, -DISTANCE))
    return ContactGuard(gait.params, SwitchingController(law, startup), margin_for(gait))


def walk(controller: ContactGuard, start: Floats, steps: int) -> tuple[Floats, Floats]:
    """Hybrid states (T + 1, STATE_SIZE) from a start to so many steps, and rows (T, len(ROW))."""
    states, rows = [start], []
    while states[-1][FOOT] < steps:
        x = states[-1][None]
        after, row = held(controller.params, x, controller(x[:, :4], x[:, MODE].astype(np.int64)))
        if broken(controller.params, row).any():
            raise RuntimeError(f"a foot lifts or slips at every voltage in the state {x[0]}")
        states.append(after[0])
        rows.append(row[0])
    return np.array(states), np.array(rows)


def stopped(params: WheelParams, states: Floats) -> tuple[Floats, Floats, Floats]:
    """Stop walking wheels, (N, STATE_SIZE), by no voltage.

    Returns:
        The states afterwards; the time until the pendulum hangs still (s), infinite where a foot
        lifts or slips or the wheel does not come to rest; and the sums of the rows, (N, len(ROW)).
    """
    x, sums = states.copy(), np.zeros((len(states), len(ROW)))
    time, moving = np.full(len(states), np.inf), np.arange(len(states))
    for tick in range(1, round(LONGEST / CONTROL_PERIOD) + 1):
        x[moving], rows = held(params, x[moving], np.zeros(len(moving)))
        sums[moving] += rows
        angle = np.remainder(x[moving, THETA] + np.pi, 2 * np.pi) - np.pi
        still = np.maximum(np.abs(angle), np.abs(x[moving, DTHETA])) < REST
        still &= x[moving, MODE] == DOUBLE
        time[moving[still]] = tick * CONTROL_PERIOD
        moving = moving[~still & ~broken(params, rows)]
    return x, time, sums


def held(params: WheelParams, states: Floats, volts: Floats) -> tuple[Floats, Floats]:
    """States and rows after a control period of the nearest voltages at which no foot slips."""
    after = states.copy()
    rows = advance(params, after, volts)
    bad = np.flatnonzero(broken(params, rows))
    if bad.size:
        others = SHARES * params.voltage_limit
        tried = np.repeat(states[bad], len(others), axis=0)
        made = advance(params, tried, np.tile(others, bad.size))
        slips = broken(params, made).reshape(bad.size, -1)
        nearest = np.where(slips, np.inf, np.abs(others - volts[bad, None])).argmin(axis=1)
        best = nearest + len(others) * np.arange(bad.size)
        after[bad], rows[bad] = tried[best], made[best]
    return after, rows


def broken(params: WheelParams, rows: Floats) -> NDArray[np.bool_]:
    """Whether a foot lifts or slips in intervals of the kernel, (N,)."""
    impulse = np.where(rows[:, ROW.collision] > SOFT, rows[:, ROW.impulse_friction_demand], 0.0)
    demand = np.maximum(rows[:, ROW.friction_demand], impulse)
    return np.asarray((rows[:, ROW.min_normal_force] <= 0.0) | exceeds(demand, params.friction))


def section(found: Sequence[Cycle], params: WheelParams) -> str:
    """The table of cycles, with what the front and its hull cost at the same mean speeds."""
    front, speeds, (*_, shorter, longest) = shipped_front(params), np.array(SPEEDS), found
    per_step = (longest.energy - shorter.energy) / (longest.steps - shorter.steps)
    once = longest.energy - per_step * longest.steps
    step_weight = params.weight * params.step_length  # J of a step per unit of CoT
    idle, least = params.idle_power / (params.weight * speeds), front(speeds)
    lines: list[list[Any]] = []
    for cycle in found:
        slow = speeds * cycle.moving <= params.step_length * cycle.steps
        cots = np.where(slow, idle + cycle.energy / (step_weight * cycle.steps), np.nan)
        lines.append([cycle.steps, f"{cycle.moving:.1f}", *_texts(cots)])
    hulls = np.interp(speeds, [gait.speed for gait in front.envelope], hull(front))
    lines.append(["endless", "", *_texts(idle + per_step / step_weight)])
    lines += [["the hull", "", *_texts(hulls)], ["the front", "", *_texts(least)]]
    enough = np.ceil(once / (step_weight * (least - idle) - per_step))
    lines.append(["steps from which it costs less", "", *(f"{steps:.0f}" for steps in enough)])
    head = ["steps", "moves (s)", *(f"{speed:g} m/s" for speed in SPEEDS)]
    return (
        f"{table(head, lines)}\n\nA start and a stop cost {once:.1f} J, a step in between "
        f"{per_step:.3f} J, both without the idle power.\n"
    )


def _texts(cots: Floats) -> list[str]:
    return ["-" if np.isnan(cot) else f"{cot:.4f}" for cot in cots]
