"""What BUILDABLE is made of, and what its assumptions are worth: the tables of docs/machine.md.

The page names the source of every number. Where an assumption changes the motion, the gait is
optimised again. It takes a few minutes of one core.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from agents.cli.options import MaybeCount, MaybePath
from rimless_gym.equations import equations
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE
from scripts.studies.documents.markdown import marks, refresh, table
from trajopt import periodic_gait, pool
from trajopt.gaits.library import warm_starts
from trajopt.gaits.solution import Solution

#: The motor: precious-metal brushes, ball bearings, 12 V winding.
MOTOR = "maxon DCX 22 L EB KL, 12 V"
MOTOR_CONSTANT = 0.0229  # N m/A
MOTOR_RESISTANCE = 1.84  # of the terminals, winding at 25 C (ohm)
ROTOR_INERTIA = 9.0e-7  # kg m^2
NO_LOAD_CURRENT = 0.020  # at nominal voltage (A)
MOTOR_MASS = 0.095  # kg
TOP_SPEED = 749.8  # of the shaft (rad/s)

#: The planetary gearhead, which the maker combines with this motor.
GEARHEAD = "maxon GPX 22 UP 21:1"
GEAR_RATIO = 20.95  # exact reduction
GEAR_EFFICIENCY = 0.93  # largest
GEAR_INERTIA = 6e-8  # at the motor's shaft (kg m^2)
GEAR_MASS = 0.078  # kg
GEAR_TORQUE = 2.9  # permissible at the output, continuously (N m)

#: Dry torque of the gearhead at its input (N m), which no data sheet gives: as much as the motor's.
GEAR_DRY_TORQUE = 0.46e-3

#: Resistance of the driver's transistors, two of them in series, and of the cables (ohm).
DRIVER_RESISTANCE = 0.06

#: Of the battery when it is nearly empty, which is the motor's nominal voltage too (V).
VOLTAGE = 12.0

#: Drawn at all times (W): driver, microcontroller, sensors, radio, converter.
ELECTRONICS_POWER = 0.5

#: Dry torque of the two ball bearings that carry the arm (N m).
BEARING_TORQUE = 0.002

TOTAL_MASS = 3.0  # kg
LEGS = 7
LEG_LENGTH = 0.3  # m: the machine stands on a table
FRICTION = 0.8  # coefficient of the ground that gaits may use

TUBE = 0.0535  # kg/m: carbon fibre, 12 mm outside and 10 mm inside, 1550 kg/m^3
HUB_RADIUS = 0.04  # m, where the legs begin
SOCKET, FOOT, CROSSBAR = 0.010, 0.010, 0.008  # kg: at the hub, at the tip, between two tips
BOB_RADIUS = 0.020  # m: steel round bar of 40 mm, cut to the wanted mass
CLAMP = 0.05  # kg: of the arm on its bearings, at the hub

#: Parts of the wheel close to the hub: kg, and distance (m) at which their mass may be thought to
#: lie.
HUB_PARTS: Mapping[str, tuple[float, float]] = {
    f"motor: {MOTOR}": (MOTOR_MASS, 0.011 / math.sqrt(2)),
    f"gearhead: {GEARHEAD}": (GEAR_MASS, 0.011 / math.sqrt(2)),
    "battery: 4 cells LiFePO4 26650, holder": (0.300, 0.040),
    "electronics and cables": (0.100, 0.040),
    "two hub plates, spacers, motor mount": (0.200, 0.035),
    "axle, two bearings, coupling": (0.060, 0.010),
}

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


def chosen() -> tuple[float, float]:
    """Bob (kg) and arm (m) of the preset."""
    assert BUILDABLE.pendulum_reach is not None
    arm = BUILDABLE.pendulum_reach - BOB_RADIUS
    return BUILDABLE.pendulum_mass - CLAMP - TUBE * arm, arm


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


# -- the machine -----------------------------------------------------------------------------------


def machine(bob: float, arm: float) -> WheelParams:
    """The machine with a bob (kg), a bar across the end of an arm (m), a tube on a clamp.

    What it lacks of its total mass is payload at the hub.
    """
    tube = TUBE * arm
    mass = bob + tube + CLAMP
    length = (bob * arm + tube * arm / 2) / mass
    about_hub = bob * (arm**2 + BOB_RADIUS**2 / 2) + tube * arm**2 / 3
    dry_torque = MOTOR_CONSTANT * NO_LOAD_CURRENT + GEAR_DRY_TORQUE
    return WheelParams(
        wheel_mass=TOTAL_MASS - mass,
        wheel_inertia=sum(inertia for _, inertia in wheel_parts().values()),
        leg_length=LEG_LENGTH,
        n_legs=LEGS,
        pendulum_mass=mass,
        pendulum_length=length,
        pendulum_inertia=about_hub - mass * length**2,
        pendulum_reach=arm + BOB_RADIUS,
        motor_constant=MOTOR_CONSTANT,
        gear_ratio=GEAR_RATIO,
        armature_resistance=MOTOR_RESISTANCE + DRIVER_RESISTANCE,
        rotor_inertia=ROTOR_INERTIA + GEAR_INERTIA,
        hub_friction=GEAR_RATIO * dry_torque + BEARING_TORQUE,
        gear_loss=1 - GEAR_EFFICIENCY,
        idle_power=ELECTRONICS_POWER,
        friction=FRICTION,
        voltage_limit=VOLTAGE,
    )


def wheel_parts() -> dict[str, tuple[float, float]]:
    """Mass (kg) and moment of inertia about the hub (kg m^2) of every part of the wheel."""
    inner, outer = HUB_RADIUS, LEG_LENGTH - 0.005
    tube, tips = TUBE * (outer - inner), LEGS * (2 * FOOT + CROSSBAR)
    parts = {name: (mass, mass * r**2) for name, (mass, r) in HUB_PARTS.items()}
    parts["legs: carbon tubes"] = (
        2 * LEGS * tube,
        2 * LEGS * tube * (inner**2 + inner * outer + outer**2) / 3,
    )
    parts["leg sockets"] = (2 * LEGS * SOCKET, 2 * LEGS * SOCKET * inner**2)
    parts["rubber feet and crossbars"] = (tips, tips * outer**2)
    return parts


def budget_table() -> str:
    """The table of the masses of the preset's parts, and their sum."""
    bob, arm = chosen()
    parts = {name: mass for name, (mass, _) in wheel_parts().items()}
    parts["bob: steel bar"] = bob
    parts[f"arm of {1000 * arm:.0f} mm and its clamp"] = BUILDABLE.pendulum_mass - bob
    parts["left for payload, at the hub"] = TOTAL_MASS - sum(parts.values())
    rows = [[name, f"{1000 * mass:.0f}"] for name, mass in parts.items()]
    rows.append(["**sum**", f"**{1000 * sum(parts.values()):.0f}**"])
    return table(["part", "mass (g)"], rows) + "\n"
