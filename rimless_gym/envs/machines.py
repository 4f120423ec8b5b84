"""Compiled: the machines of many rows, whose parameters are drawn when an episode begins."""

from __future__ import annotations

import dataclasses
import math

from rimless_gym import hybrid
from rimless_gym.envs.layout import Machine, reader, set_machine
from rimless_gym.envs.randomness import between
from rimless_gym.equations import record
from rimless_gym.hybrid import MAX_RATE
from rimless_gym.jit import cached, inner
from rimless_gym.kernel.stepping import MAX_POLE
from rimless_gym.params import (
    CHOICES,
    LEAST_REGULARITY,
    Constants,
    WheelParams,
    constants_of,
    leg_angle_of,
    reach_of,
    rod_reach,
    step_length_of,
    weight_of,
)

#: The parameters that are numbers, in the order of the arrays `numbers` (len(NUMBERS), N).
Numbers = record(
    "Numbers",
    [field.name for field in dataclasses.fields(WheelParams) if field.name not in CHOICES],
    __name__,
)
NUMBERS = Numbers._fields

#: Stands in `Numbers` for a `pendulum_reach` of None.
LEFT_OPEN = -1.0

_D1, _LAW, _REACH = (Constants._fields.index(name) for name in ("d1", "law", "reach"))
_numbers_of = reader(Numbers, 0)
for _function in (weight_of, leg_angle_of, step_length_of, rod_reach, reach_of, constants_of):
    inner(_function)


def numbers_of(params: WheelParams) -> list[float]:
    """The values of `NUMBERS` of a machine."""
    values = (getattr(params, name) for name in NUMBERS)
    return [LEFT_OPEN if value is None else float(value) for value in values]


@inner
def _set_terms(numbers, memory, i):
    """Write what the task needs to know about row i's machine."""
    f = _numbers_of(numbers, i)
    machine = Machine(
        voltage_limit=f.voltage_limit,
        idle_power=f.idle_power,
        friction=f.friction,
        weight=weight_of(f),
        slope=f.slope,
        leg_scale=2 / leg_angle_of(f),
        credit_limit=step_length_of(f),
    )
    set_machine(memory, i, machine)


@inner
def _pole(limit, p):
    """The motor's pole (1/s); beyond `MAX_POLE` where the machine cannot be stepped.

    See `rimless_gym.kernel.stepping.require_steppable`.
    """
    regular = hybrid.least_regularity(p) > LEAST_REGULARITY
    stall = hybrid.motor_torque(0.0, limit, p)
    stiffest = max(hybrid.drag_pole(MAX_RATE, p), hybrid.friction_pole(0.0, stall, p))
    if regular and stiffest <= MAX_POLE:
        return hybrid.hub_pole(p)
    return 2 * MAX_POLE


@cached()
def draw_machines(rows, ranged, bounds, numbers, constants, poles, memory, streams):
    """Draw the parameters `ranged` of each machine of `rows` between `bounds`.

    It returns a row whose machine cannot be stepped, or -1.
    """
    failed = -1
    for i in rows:
        for k in range(len(ranged)):
            numbers[ranged[k], i] = between(bounds[k, 0], bounds[k, 1], streams, i)
        f = _numbers_of(numbers, i)
        p = constants_of(f, constants[_D1, i], constants[_LAW, i], math.sin, math.cos)
        for k, value in enumerate(p):
            constants[k, i] = value
        if f.pendulum_reach == LEFT_OPEN:
            constants[_REACH, i] = rod_reach(f)
        poles[i] = _pole(f.voltage_limit, p)
        _set_terms(numbers, memory, i)
        if not poles[i] <= MAX_POLE:
            failed = i
    return failed


@cached()
def set_terms(numbers, memory):
    """Write what the task needs to know about each row's machine into `memory`."""
    for i in range(numbers.shape[1]):
        _set_terms(numbers, memory, i)
