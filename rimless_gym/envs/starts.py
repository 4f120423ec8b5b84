"""Compiled: how episodes begin, for many rows. Machine, state, delay, first observation.

All of an episode's randomness comes from one key per row; see `rimless_gym.envs.randomness`.
"""

from __future__ import annotations

import dataclasses
import math
from collections import namedtuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple

from rimless_gym import hybrid
from rimless_gym.envs.interval import (
    COMMAND,
    COUNT,
    DELAY,
    END_CHARGE,
    FRICTION,
    IDLE_POWER,
    LEG_SCALE,
    SLOPE,
    TIME,
    VALUE_OF_DISTANCE,
    VOLTAGE,
    VOLTAGE_LIMIT,
    WEIGHT,
    observe_row,
)
from rimless_gym.envs.perturbation import (
    GREATEST_DELAY,
    LEAST_DELAY,
    is_noisy,
    machine,
    observe_noisily,
)
from rimless_gym.envs.randomness import between, next_uniform
from rimless_gym.envs.task import draw_state, greatest_force
from rimless_gym.hybrid import DOUBLE
from rimless_gym.jit import inner, kept
from rimless_gym.kernel.stepping import (
    DPHI,
    DTHETA,
    FOOT,
    MAX_POLE,
    MODE,
    PHI,
    THETA,
)
from rimless_gym.params import CHOICES, Constants, WheelParams, constants_of

DRAWN, GIVEN, HANGING = range(3)  # kinds of start; the last is at rest on two feet

#: The parameters that are numbers, in the order of the arrays `fields` (N_FIELDS, N).
FIELDS = tuple(field.name for field in dataclasses.fields(WheelParams) if field.name not in CHOICES)
N_FIELDS = len(FIELDS)
Fields = namedtuple("Fields", FIELDS)  # type: ignore[misc]

_D1, _LAW = Constants._fields.index("d1"), Constants._fields.index("law")
_solve = hybrid.eq.solve
_constants_of = inner(constants_of)


@inner
def _set_terms(fields, prices, memory, i):
    """What the task needs of row i's machine; `prices` are the fields of a `Task`."""
    f = Fields(*to_fixed_tuple(fields[:, i], N_FIELDS))
    value_of_distance, fall_distance, horizon = prices
    weight = (f.wheel_mass + f.pendulum_mass) * f.gravity
    memory[VOLTAGE_LIMIT, i], memory[IDLE_POWER, i] = f.voltage_limit, f.idle_power
    memory[FRICTION, i], memory[WEIGHT, i], memory[SLOPE, i] = f.friction, weight, f.slope
    memory[LEG_SCALE, i] = 2 / (2 * math.pi / f.n_legs)
    memory[VALUE_OF_DISTANCE, i] = value_of_distance
    memory[END_CHARGE, i] = value_of_distance * fall_distance + f.idle_power * horizon / weight


@inner
def _motor_pole(p):
    """As `WheelParams.motor_pole`; beyond `MAX_POLE` where the mass matrix is singular.

    The mobility of psi is (M11 + M22 - 2 M12) / (M11 M22 - M12^2) or M11 / (M11 M22 - M12^2),
    greatest at the ends of M12's range.
    """
    fastest = 0.0
    for angle in (-math.pi / 2, math.pi / 2):
        m11, m12, m22 = hybrid.mass_matrix(0.0, angle, p)
        if m11 * m22 - m12 * m12 <= 1e-12 * m11 * m22:
            return 2 * MAX_POLE
        rates = _solve(m11, m12, m22, p.d1, 1.0)
        fastest = max(fastest, hybrid.relative_rate(rates[0], rates[1], p))
    return (p.K * p.K / p.Rm + p.damping) * fastest


@inner
def _draw_machine(ranged, bounds, fields, prices, constants, poles, memory, streams, i):
    """Draw row i's machine; False if it cannot be stepped."""
    for k in range(len(ranged)):
        fields[ranged[k], i] = between(bounds[k, 0], bounds[k, 1], streams, i)
    f = Fields(*to_fixed_tuple(fields[:, i], N_FIELDS))
    p = _constants_of(f, constants[_D1, i], constants[_LAW, i], math.sin, math.cos)
    for k, value in enumerate(p):
        constants[k, i] = value
    poles[i] = _motor_pole(p)
    _set_terms(fields, prices, memory, i)
    return poles[i] <= MAX_POLE


@inner
def _set_state(kind, given, k, p, memory, streams, i):
    """Write the state in which row i starts; False if the ground would have to pull there.

    A drawn one must press without voltage, a given one at some voltage.
    """
    if kind == DRAWN:
        pressed, mode, phi, theta, dphi, dtheta = draw_state(
            memory[SLOPE, i], memory[WEIGHT, i], p, streams, i
        )
    else:
        if kind == HANGING:
            mode, phi, theta, dphi, dtheta = DOUBLE, p.a, memory[SLOPE, i], 0.0, 0.0
        else:
            phi, theta, dphi, dtheta = given[k, 0], given[k, 1], given[k, 2], given[k, 3]
            mode = int(given[k, 4])
        limit = memory[VOLTAGE_LIMIT, i]
        pressed = greatest_force(float(mode), phi, theta, dphi, dtheta, limit, p) > 0.0
    memory[PHI, i], memory[THETA, i], memory[DPHI, i] = phi, theta, dphi
    memory[DTHETA, i], memory[MODE, i], memory[FOOT, i] = dtheta, mode, 0.0
    return pressed


@kept()
def start_rows(observations, rows, kind, given, memory, streams, held, constants, settings):
    """Begin the episodes of `rows` at a start of `kind`; a row that found none, or -1.

    It is drawn, or one of the states `given` (one per row: phi, theta, phi', theta', mode).
    """
    failed = -1
    noisy = is_noisy(settings)
    for k in range(len(rows)):
        i = rows[k]
        if not _set_state(kind, given, k, machine(constants, i), memory, streams, i):
            failed = i
            continue
        memory[COMMAND, i] = memory[VOLTAGE, i] = memory[TIME, i] = memory[COUNT, i] = 0.0
        memory[DELAY, i], held[:, i] = settings[LEAST_DELAY], 0.0
        choices = settings[GREATEST_DELAY] - settings[LEAST_DELAY] + 1.0
        if choices > 1.0:
            memory[DELAY, i] += math.floor(choices * next_uniform(streams, i))
        if noisy:
            observe_noisily(memory, streams, settings, observations, i)
        else:
            observe_row(memory, observations, np.uint64(i))
    return failed


@kept()
def draw_machines(rows, ranged, bounds, fields, prices, constants, poles, memory, streams):
    """Draw the fields `ranged` of each machine of `rows` between `bounds`, before `start_rows`.

    It returns a row whose machine cannot be stepped, or -1.
    """
    failed = -1
    for i in rows:
        if not _draw_machine(ranged, bounds, fields, prices, constants, poles, memory, streams, i):
            failed = i
    return failed


@kept()
def set_terms(fields, prices, memory):
    """Write what the task needs of each row's machine into `memory`."""
    for i in range(fields.shape[1]):
        _set_terms(fields, prices, memory, i)
