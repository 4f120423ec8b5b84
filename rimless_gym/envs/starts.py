"""Where episodes start: random states in which the feet press, or given states.

All of an episode's randomness comes from one key per row; see `rimless_gym.envs.randomness`.
"""

from __future__ import annotations

import math

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import NDArray

from rimless_gym import hybrid
from rimless_gym.envs.layout import MEMORY
from rimless_gym.envs.observation import COMMANDED_SIZE, NO_ERRORS, OBSERVATION_SIZE, observe_row
from rimless_gym.envs.perturbation import errors, machine_at
from rimless_gym.envs.randomness import between, next_uniform
from rimless_gym.envs.start_shares import USUAL_STARTS, Starts
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.jit import cached, inner
from rimless_gym.kernel.stepping import DPHI, DTHETA, MODE, PHI, STATE_SIZE, THETA
from rimless_gym.params import N_CONSTANTS, Constants, WheelParams

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
    """A random start from stream i: (found, mode, phi, theta, phi', theta').

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

    Raises:
        RuntimeError: 1000 draws found none (such a machine hardly presses on the ground).
    """
    streams = np.array([rng.bit_generator.random_raw()], dtype=np.uint64)
    state = np.zeros(STATE_SIZE)
    machine = params.constants_array, params.slope, params.weight, params.voltage_limit
    if not _draw(*machine, starts.bounds, streams, state):
        raise RuntimeError(NO_START)
    return state


@cached()
def _draw(constants, slope, weight, limit, bounds, streams, state):
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    found, state[MODE], state[PHI], state[THETA], state[DPHI], state[DTHETA] = draw_state(
        slope, weight, limit, bounds, p, streams, 0
    )
    return found


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
    those of `Starts`, and `settings` are `rimless_gym.envs.perturbation.Settings`. `commands` has
    the least and the greatest target speed (m/s) per row, between which one is drawn; it is empty
    where none is commanded.
    """
    failed, noisy, commanded = -1, settings.noise != NO_ERRORS, len(commands) > 0
    width = np.uint64(COMMANDED_SIZE if commanded else OBSERVATION_SIZE)
    for k in range(len(rows)):
        i = rows[k]
        if not _set_state(kind, given, k, bounds, machine_at(constants, i), memory, streams, i):
            failed = i
            continue
        memory[MEMORY.action, i] = memory[MEMORY.voltage, i] = 0.0
        memory[MEMORY.credit, i] = memory[MEMORY.credit_limit, i]
        memory[MEMORY.time, i] = memory[MEMORY.count, i] = 0.0
        memory[MEMORY.push_work, i] = memory[MEMORY.push_shift, i] = 0.0
        memory[MEMORY.delay, i], held[:, i] = settings.least_delay, 0.0
        choices = settings.greatest_delay - settings.least_delay + 1.0
        if choices > 1.0:
            memory[MEMORY.delay, i] += math.floor(choices * next_uniform(streams, i))
        if commanded:
            speed = between(commands[k, 0], commands[k, 1], streams, i)
            memory[MEMORY.target_speed, i] = speed
        wrong = errors(settings.noise, streams, i) if noisy else NO_ERRORS
        observe_row(memory, wrong, observations, width, np.uint64(i))
    return failed
