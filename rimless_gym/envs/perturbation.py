"""Compiled: how `disturbances` act on rows, before and after their control interval."""

from __future__ import annotations

from numba.np.unsafe.ndarray import to_fixed_tuple

from rimless_gym import energy as row
from rimless_gym.envs.interval import (
    COMMAND,
    COUNT,
    DELAY,
    LEG_SCALE,
    PUSH,
    PUSH_SHIFT,
    PUSH_WORK,
)
from rimless_gym.envs.randomness import between, next_uniform, normal
from rimless_gym.envs.task import OBSERVATION_SIZE, observation
from rimless_gym.hybrid import DOUBLE, SINGLE, kinetic_energy, push
from rimless_gym.jit import inner, kept
from rimless_gym.kernel.stepping import DPHI, DTHETA, FOOT, MODE, PHI, THETA
from rimless_gym.params import N_CONSTANTS, Constants

# `settings` (SETTINGS_SIZE,), as `Disturbances.settings` makes them.
(
    PUSH_CHANCE,  # per interval
    LEAST_IMPULSE,
    GREATEST_IMPULSE,
    LEAST_DELAY,
    GREATEST_DELAY,
    LEG_ANGLE_NOISE,  # and those of theta, phi', theta' after it
) = range(6)
SETTINGS_SIZE = LEG_ANGLE_NOISE + 4


@inner
def machine(constants, i):
    """The constants of row i."""
    column = constants[:, i if constants.shape[1] > 1 else 0]
    return Constants(*to_fixed_tuple(column, N_CONSTANTS))


@inner
def observe_noisily(memory, streams, settings, observations, i):
    """Write the observation of row i with the sensors' errors, within its bounds as ever."""
    error = LEG_ANGLE_NOISE
    values = observation(
        memory[PHI, i] + settings[error] * normal(streams, i),
        memory[THETA, i] + settings[error + 1] * normal(streams, i),
        memory[DPHI, i] + settings[error + 2] * normal(streams, i),
        memory[DTHETA, i] + settings[error + 3] * normal(streams, i),
        memory[MODE, i],
        memory[LEG_SCALE, i],
    )
    for k in range(OBSERVATION_SIZE):
        observations[i * OBSERVATION_SIZE + k] = values[k]


@inner
def is_noisy(settings):
    """Whether any sensor errs."""
    return settings[LEG_ANGLE_NOISE:].any()


@inner
def _delay(memory, held, i):
    """Put the command given DELAY intervals ago in the place of the one given now."""
    length, now = held.shape[0], int(memory[COUNT, i])
    held[now % length, i] = memory[COMMAND, i]
    memory[COMMAND, i] = held[(now + length - int(memory[DELAY, i])) % length, i]


@inner
def _push(memory, impulse, p, i):
    """Push row i's hub along the ground; in double stance it tips over one of the feet."""
    mode, phi, shift = memory[MODE, i], memory[PHI, i], 0
    theta, dphi, dtheta = memory[THETA, i], memory[DPHI, i], memory[DTHETA, i]
    if mode == DOUBLE and impulse < 0.0:
        phi, shift = p.b, -1
    before = kinetic_energy(phi, theta, dphi, dtheta, p)
    dphi, dtheta = push(phi, theta, dphi, dtheta, impulse, 0.0, p)
    memory[MODE, i], memory[PHI, i], memory[FOOT, i] = SINGLE, phi, memory[FOOT, i] + shift
    memory[DPHI, i], memory[DTHETA, i] = dphi, dtheta
    memory[PUSH_WORK, i] = kinetic_energy(phi, theta, dphi, dtheta, p) - before
    memory[PUSH_SHIFT, i] = shift


@kept(nogil=True)
def disturb_rows(memory, constants, streams, held, settings, first, last):
    """Before the interval: delay the commands, and push.

    `held` (longest delay + 1, N) keeps commands until they act.
    """
    for i in range(first, last):
        _delay(memory, held, i)
        memory[PUSH_WORK, i] = memory[PUSH_SHIFT, i] = 0.0
        if settings[PUSH_CHANCE] > 0.0 and next_uniform(streams, i) < settings[PUSH_CHANCE]:
            impulse = between(settings[LEAST_IMPULSE], settings[GREATEST_IMPULSE], streams, i)
            if next_uniform(streams, i) < 0.5:
                impulse = -impulse
            if impulse != 0.0:
                _push(memory, impulse, machine(constants, i), i)


@kept(nogil=True)
def account_rows(observations, block, memory, streams, settings, first, last):
    """After the interval: add the push's work to the ledger, and the sensors' errors."""
    noisy = is_noisy(settings)
    for i in range(first, last):
        block[PUSH, i] = memory[PUSH_WORK, i]
        block[row.MECHANICAL_CHANGE, i] += memory[PUSH_WORK, i]
        block[row.STEPS, i] += memory[PUSH_SHIFT, i]
        if noisy:
            observe_noisily(memory, streams, settings, observations, i)
