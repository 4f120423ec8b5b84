"""How episodes begin: states in which the feet press, and machines drawn from ranges.

All of an episode's randomness comes from one key per row; see `rimless_gym.envs.disturbances`.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from rimless_gym import hybrid
from rimless_gym.checks import not_negative
from rimless_gym.envs.disturbances import errors
from rimless_gym.envs.layout import (
    COMMANDED_SIZE,
    MEMORY,
    NO_ERRORS,
    OBSERVATION_SIZE,
    TaskParams,
    observe_row,
    params_at,
    reader,
    set_task_params,
)
from rimless_gym.equations import DOUBLE, SINGLE, record
from rimless_gym.hybrid import MAX_RATE
from rimless_gym.jit import cached, inner
from rimless_gym.kernel.stepping import DPHI, DTHETA, MAX_POLE, MODE, PHI, STATE_SIZE, THETA
from rimless_gym.params import (
    CHOICES,
    LEAST_REGULARITY,
    N_CONSTANTS,
    Constants,
    WheelParams,
    constants_of,
    leg_angle_of,
    reach_of,
    rod_reach,
    step_length_of,
    weight_of,
)
from rimless_gym.streams import between, next_uniform


@dataclasses.dataclass(frozen=True)
class Starts:
    """Shares of the kinds of start that are drawn; what counts is their size to each other.

    Attributes:
        rest: at rest on two feet, the pendulum near hanging.
        moving: in single stance, the pendulum anywhere and slow.
        whirling: in single stance, the pendulum anywhere and turning at 6 to 16 rad/s, in either
            sense. Efficient gaits whirl; an untrained policy hardly ever gets there from the other
            starts.

    Raises:
        TypeError: a share is not a number.
        ValueError: a share is negative or not finite, or all are 0.
    """

    rest: float = 0.25
    moving: float = 0.75
    whirling: float = 0.0

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            object.__setattr__(self, name, not_negative(name, value))
        if not self.rest + self.moving + self.whirling > 0.0:
            raise ValueError(f"{self}: one of the shares must be greater than 0")

    @property
    def bounds(self) -> tuple[float, float]:
        """What a number in [0, 1) must be below for rest, and at least for whirling."""
        total = self.rest + self.moving + self.whirling
        return self.rest / total, 1.0 - self.whirling / total


#: One start in four at rest, none whirling.
USUAL_STARTS = Starts()


DRAWN, GIVEN, HANGING = range(3)  # kinds of start; the last is at rest on two feet

#: Starts at rest are on two feet, the others in single stance. They are drawn uniformly from these
#: ranges.
REST_ANGLE, REST_RATE = 0.5, 1.0  # |theta| from hanging (rad), |theta'| (rad/s)
MOVING_LEG_RATE = (0.0, 2.0)  # phi' (rad/s)
MOVING_PENDULUM_RATE = 3.0  # |theta'| (rad/s), at any angle theta
WHIRLING_PENDULUM_RATE = (6.0, 16.0)  # |theta'| (rad/s), at any angle theta, in either sense
LEAST_FORCE = 0.05  # of the foot of a moving wheel on the ground, in weights
DRAWS = 1000  # before giving up

NO_START = (
    "no start found in which the foot presses on the ground: the pendulum is too heavy or too "
    "long for this wheel, or the slope too steep; give reset(options={'state': ...})"
)


@inner
def greatest_force(mode, phi, theta, dphi, dtheta, limit, p):
    """The largest Fy (N) that a voltage from -limit to limit gives: it is at one of the two."""
    return max(
        hybrid.foot_force(mode, phi, theta, dphi, dtheta, -limit, p),
        hybrid.foot_force(mode, phi, theta, dphi, dtheta, limit, p),
    )


@inner
def draw_state(slope, weight, limit, bounds, p, streams, i):
    """A random start from stream i: (pressed, mode, phi, theta, phi', theta').

    `bounds` are those of `Starts`. The feet of a wheel at rest press without voltage, the foot of
    a moving one too; that of a wheel with a whirling pendulum at some voltage up to `limit`.
    """
    for _ in range(DRAWS):
        kind = next_uniform(streams, i)
        if kind < bounds[0]:
            theta = slope + between(-REST_ANGLE, REST_ANGLE, streams, i)
            dtheta = between(-REST_RATE, REST_RATE, streams, i)
            if hybrid.both_feet_press(theta, dtheta, 0.0, p):
                return True, DOUBLE, p.a, theta, 0.0, dtheta
        else:
            phi = between(p.a, p.b, streams, i)
            theta = between(-math.pi, math.pi, streams, i)
            dphi = between(MOVING_LEG_RATE[0], MOVING_LEG_RATE[1], streams, i)
            if kind < bounds[1]:
                dtheta = between(-MOVING_PENDULUM_RATE, MOVING_PENDULUM_RATE, streams, i)
                force = hybrid.foot_force(float(SINGLE), phi, theta, dphi, dtheta, 0.0, p)
            else:
                slowest, fastest = WHIRLING_PENDULUM_RATE
                dtheta = between(slowest, fastest, streams, i)
                if next_uniform(streams, i) < 0.5:
                    dtheta = -dtheta
                force = greatest_force(float(SINGLE), phi, theta, dphi, dtheta, limit, p)
            if force > LEAST_FORCE * weight:
                return True, SINGLE, phi, theta, dphi, dtheta
    return False, SINGLE, p.a, 0.0, 0.0, 0.0


def draw_start(
    params: WheelParams, rng: np.random.Generator, starts: Starts = USUAL_STARTS
) -> NDArray[np.float64]:
    """A random hybrid state (STATE_SIZE,) in which the feet press.

    It takes one 64-bit number from `rng`. An environment with this generator and these `starts`
    starts in the same state.
    """
    streams = np.array([rng.bit_generator.random_raw()], dtype=np.uint64)
    state = np.zeros(STATE_SIZE)
    known = params.constants_array, params.slope, params.weight, params.voltage_limit
    if not _draw(*known, starts.bounds, streams, state):
        raise RuntimeError(NO_START)
    return state


@cached()
def _draw(constants, slope, weight, limit, bounds, streams, state):
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    pressed, state[MODE], state[PHI], state[THETA], state[DPHI], state[DTHETA] = draw_state(
        slope, weight, limit, bounds, p, streams, 0
    )
    return pressed


def normal_force(params: WheelParams, state: NDArray[np.float64], limit: float = 0.0) -> float:
    """The largest Fy (N) that a voltage from -limit to limit gives in a state (STATE_SIZE,)."""
    return _force(params.constants_array, state, limit)


@cached()
def _force(constants, x, limit):
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    return greatest_force(x[MODE], x[PHI], x[THETA], x[DPHI], x[DTHETA], limit, p)


@inner
def _set_state(kind, given, k, bounds, p, memory, streams, i):
    """Write row i's first state; returns False if the ground would have to pull the feet there.

    See `draw_state` for drawn states; in a given one, the feet must press at some voltage.
    """
    limit = memory[MEMORY.voltage_limit, i]
    if kind == DRAWN:
        slope, weight = memory[MEMORY.slope, i], memory[MEMORY.weight, i]
        pressed, mode, phi, theta, dphi, dtheta = draw_state(
            slope, weight, limit, bounds, p, streams, i
        )
    else:
        if kind == HANGING:
            mode, phi, theta, dphi, dtheta = DOUBLE, p.a, memory[MEMORY.slope, i], 0.0, 0.0
        else:
            phi, theta, mode = given[k, PHI], given[k, THETA], int(given[k, MODE])
            dphi, dtheta = given[k, DPHI], given[k, DTHETA]
        pressed = greatest_force(float(mode), phi, theta, dphi, dtheta, limit, p) > 0.0
    memory[MEMORY.phi, i], memory[MEMORY.theta, i], memory[MEMORY.mode, i] = phi, theta, mode
    memory[MEMORY.dphi, i], memory[MEMORY.dtheta, i], memory[MEMORY.foot, i] = dphi, dtheta, 0.0
    return pressed


@cached()
def start_rows(
    observations, rows, kind, given, bounds, commands, memory, streams, held, constants, settings
):
    """Begin the episodes of `rows` at starts of `kind`; returns a row that found none, or -1.

    For GIVEN starts, `given` has one state per row: phi, theta, phi', theta', mode. `bounds` are
    those of `Starts`, and `settings` are `rimless_gym.envs.disturbances.Settings`. `commands` has
    the least and the greatest target speed (m/s) per row, between which one is drawn; it is empty
    where none is commanded.
    """
    failed, noisy, commanded = -1, settings.noise != NO_ERRORS, len(commands) > 0
    width = np.uint64(COMMANDED_SIZE if commanded else OBSERVATION_SIZE)
    for k in range(len(rows)):
        i = rows[k]
        if not _set_state(kind, given, k, bounds, params_at(constants, i), memory, streams, i):
            failed = i
            continue
        memory[MEMORY.action, i] = memory[MEMORY.voltage, i] = 0.0
        memory[MEMORY.allowance, i] = memory[MEMORY.allowance_limit, i]
        memory[MEMORY.time, i] = memory[MEMORY.count, i] = 0.0
        memory[MEMORY.push_work, i] = memory[MEMORY.push_shift, i] = 0.0
        memory[MEMORY.delay, i], held[:, i] = settings.least_delay, 0.0
        choices = settings.greatest_delay - settings.least_delay + 1.0
        if choices > 1.0:
            memory[MEMORY.delay, i] += math.floor(choices * next_uniform(streams, i))
        memory[MEMORY.slope_std, i] = settings.slope_std
        if settings.slope_std > 0.0:
            memory[MEMORY.ground_seed, i] = next_uniform(streams, i)
        if commanded:
            speed = between(commands[k, 0], commands[k, 1], streams, i)
            memory[MEMORY.target_speed, i] = speed
        wrong = errors(settings.noise, streams, i) if noisy else NO_ERRORS
        observe_row(memory, wrong, observations, width, np.uint64(i))
    return failed


# Machines, whose parameters are drawn when an episode begins

#: The parameters that are numbers, in the order of the arrays `numbers` (len(NUMBERS), N).
Numbers = record(
    "Numbers",
    [field.name for field in dataclasses.fields(WheelParams) if field.name not in CHOICES],
    __name__,
)
NUMBERS = Numbers._fields

#: It stands in `Numbers` for a `pendulum_reach` of None.
UNSET_REACH = -1.0

_D1, _LAW, _REACH = (Constants._fields.index(name) for name in ("d1", "law", "reach"))
_numbers_of = reader(Numbers, 0)
for _function in (weight_of, leg_angle_of, step_length_of, rod_reach, reach_of, constants_of):
    inner(_function)


def numbers_of(params: WheelParams) -> list[float]:
    """A machine's values of `NUMBERS`."""
    values = (getattr(params, name) for name in NUMBERS)
    return [UNSET_REACH if value is None else float(value) for value in values]


@inner
def _set_task_constants(numbers, memory, i):
    """Write what the task needs to know about row i's machine."""
    f = _numbers_of(numbers, i)
    known = TaskParams(
        voltage_limit=f.voltage_limit,
        idle_power=f.idle_power,
        friction=f.friction,
        weight=weight_of(f),
        slope=f.slope,
        leg_scale=2 / leg_angle_of(f),
        allowance_limit=step_length_of(f),
    )
    set_task_params(memory, i, known)


@inner
def _pole(limit, p):
    """The motor's pole (1/s); beyond `MAX_POLE` where the machine cannot be stepped.

    See `rimless_gym.kernel.stepping.require_steppable`.
    """
    regular = hybrid.least_regularity(p) > LEAST_REGULARITY
    stall = hybrid.motor_torque(0.0, limit, p)
    stiffest = max(hybrid.drag_pole(MAX_RATE, MAX_RATE, p), hybrid.friction_pole(0.0, stall, p))
    if regular and stiffest <= MAX_POLE:
        return hybrid.hub_pole(p)
    return 2 * MAX_POLE


@cached()
def draw_params(rows, ranged, bounds, numbers, constants, poles, memory, streams):
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
        if f.pendulum_reach == UNSET_REACH:
            constants[_REACH, i] = rod_reach(f)
        poles[i] = _pole(f.voltage_limit, p)
        _set_task_constants(numbers, memory, i)
        if not poles[i] <= MAX_POLE:
            failed = i
    return failed


@cached()
def set_task_constants(numbers, memory):
    """Write what the task needs to know about each row's machine into `memory`."""
    for i in range(numbers.shape[1]):
        _set_task_constants(numbers, memory, i)
