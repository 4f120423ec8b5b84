"""The tables of docs/machine.md: its mass budget, and what its assumptions are worth.

Where an assumption changes the motion, the gait is optimised again. It takes a few minutes of one
core.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from agents.cli.options import MaybeCount, MaybePath
from rimless_gym.equations import equations
from rimless_gym.presets import BUILDABLE
from scripts.studies.documents.markdown import marks, refresh, table
from scripts.studies.machine import BOB_RADIUS, budget, chosen
from trajopt import periodic_gait, pool
from trajopt.gaits.library import warm_starts
from trajopt.gaits.solution import Solution

#: Speeds of the gaits (m/s): near the front's best, and a slower one.
SPEEDS = (0.6375, 0.566)

#: Idle powers (W) and frequencies of the driver (Hz) in the table.
IDLE, FREQUENCIES = (0.0, 1.0, 2.0), (20e3, 50e3, 100e3)

#: Density of air (kg/m^3), the bob's bar (kg/m), and its drag coefficients: a cylinder four times
#: as long as wide, and a long one.
AIR, BAR, DRAG_COEFFICIENTS = 1.2, 9.86, (0.7, 1.1)

#: Inductance of the motor over its resistance (s).
TIME_CONSTANT = 1e-4

MARKS = marks("assumptions", ("budget", "sensitivity"))

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)


def bob_drag(coefficient: float) -> float:
    """`pendulum_drag` (N m s^2) of the bob, a bar across the arm, by its drag coefficient."""
    bob, arm = chosen()
    area = 2 * BOB_RADIUS * bob / BAR
    return 0.5 * AIR * coefficient * area * arm**3


#: Fields of the machine that differ, by the row of the table. Each has gaits of its own.
CHANGES: Mapping[str, Mapping[str, float]] = {
    "as assumed": {},
    "1.5 times the hub friction": {"hub_friction": 1.5 * BUILDABLE.hub_friction},
    "twice the hub friction": {"hub_friction": 2 * BUILDABLE.hub_friction},
    "no gear loss": {"gear_loss": 0.0},
    "twice the gear loss": {"gear_loss": 2 * BUILDABLE.gear_loss},
    **{
        f"windage of the bob, drag coefficient {c:g}": {"pendulum_drag": bob_drag(c)}
        for c in DRAG_COEFFICIENTS
    },
}


def assumptions(*, workers: MaybeCount = None, docs: MaybePath = None) -> int:
    """Measure how the least cost of transport depends on the machine's assumptions.

    Args:
        workers: processes; by default one for every core.
        docs: a page, docs/machine.md, to put the tables into.
    """
    tasks = [(row, speed) for row in CHANGES for speed in SPEEDS]
    gaits = dict(pool.run(changed_gait, tasks, workers, progress="assumptions"))
    for (row, speed), gait in gaits.items():
        if not gait.verification.passed:
            raise RuntimeError(f"{row}, {speed} m/s: {'; '.join(gait.verification.failures)}")
    assumed = [gaits["as assumed", speed] for speed in SPEEDS]
    rows = [(row, [gaits[row, speed].cot for speed in SPEEDS]) for row in CHANGES]
    rows += [
        (row, [a.cot + more for a, more in zip(assumed, mores, strict=True)])
        for row, mores in _added(assumed)
    ]
    head = ["assumption", *(f"CoT at {speed:g} m/s" for speed in SPEEDS)]
    cells = [[row, *map(_cell, cots, rows[0][1])] for row, cots in rows]
    text = table(head, cells) + "\n"
    if docs:
        refresh(docs, MARKS, {"budget": budget_table(), "sensitivity": text})
    print(text)
    return 0


def budget_table() -> str:
    """The table of the parts' masses."""
    return table(["part", "mass (g)"], budget()) + "\n"


def changed_gait(task: tuple[str, float]) -> Solution:
    """The gait of one step of a row's machine at a speed, from the preset's."""
    row, speed = task
    guess = warm_starts(BUILDABLE, speed, 1, 1)[0]
    return periodic_gait(BUILDABLE.replace(**CHANGES[row]), speed, guess=guess)


def _added(gaits: Sequence[Solution]) -> Iterator[tuple[str, list[float]]]:
    """Rows of what leaves the motion as it is, with the CoT that it adds to each gait."""
    for idle in IDLE:
        change = idle - BUILDABLE.idle_power
        yield f"idle power {idle:g} W", [change / _scale(gait) for gait in gaits]
    yield "friction as a sum, F0 + c |T|", [_summed_friction(g) / _scale(g) for g in gaits]
    for frequency in FREQUENCIES:
        name = f"ripple of the current, driver at {frequency / 1e3:g} kHz"
        yield name, [ripple_loss(gait, frequency) / _scale(gait) for gait in gaits]


def _scale(gait: Solution) -> float:
    """Weight times speed (W)."""
    return gait.params.weight * gait.speed


def _summed_friction(gait: Solution) -> float:
    """Mean power (W) that dry friction takes if its two parts add up, not their squares."""
    p, (phi, theta, dphi, dtheta), u = gait.params.constants, *_sampled(gait)
    accelerations = _eq.single_stance(phi, theta, dphi, dtheta, u, p)
    dpsi, ddpsi = _eq.relative_rate(dphi, dtheta, p), _eq.relative_rate(*accelerations, p)
    torque = _eq.gear_torque(dpsi, ddpsi, u, p)
    more = p.F0 + p.c * abs(torque) - _eq.friction_level(torque, p)
    return float(np.mean(more * _eq.slide(dpsi, p) * dpsi))


def ripple_loss(gait: Solution, frequency: float) -> float:
    """Mean power (W) that the ripple of the current loses in the windings.

    The driver switches between the battery's voltage Vb and 0 for the share D = V / Vb of a period.
    The current goes up and down by Vb D (1 - D) / (L f), in straight lines: the square of its
    root mean square is a twelfth of the square of this.
    """
    params, (_, u) = gait.params, _sampled(gait)
    share = abs(u) / params.voltage_limit
    inductance = TIME_CONSTANT * params.armature_resistance
    swing = params.voltage_limit * share * (1 - share) / (inductance * frequency)
    return float(np.mean(params.armature_resistance * swing**2 / 12))


def _sampled(gait: Solution) -> tuple[Any, Any]:
    """States (4, N) and voltages (N,) at the middles of N equal parts of the stride."""
    t = gait.duration * (np.arange(20_000) + 0.5) / 20_000
    return gait.state(t).T, gait.control(t)


def _cell(cot: float, assumed: float) -> str:
    change = cot / assumed - 1
    return f"{cot:.4f}" + (f" ({change:+.1%})" if abs(change) > 1e-9 else "")
