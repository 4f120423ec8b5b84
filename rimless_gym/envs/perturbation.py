"""Compiled: how `disturbances` act on rows, before and after their control interval."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rimless_gym.envs.layout import MEMORY, constants_of
from rimless_gym.envs.observation import observe_row
from rimless_gym.envs.randomness import between, next_uniform, normal
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.hybrid import kinetic_energy, push
from rimless_gym.jit import cached, inner


class Settings(NamedTuple):
    """The numbers of a `Disturbances`.

    Attributes:
        push_chance: probability of a push in an interval.
        least_impulse: smallest impulse of a push (N s).
        greatest_impulse: largest impulse of a push (N s).
        least_delay: shortest delay from action to voltage (intervals).
        greatest_delay: longest delay from action to voltage (intervals).
        noise: standard deviations of phi (rad), theta (rad), phi' (rad/s) and theta' (rad/s).
    """

    push_chance: float
    least_impulse: float
    greatest_impulse: float
    least_delay: int
    greatest_delay: int
    noise: tuple[float, float, float, float]

    @property
    def noisy(self) -> bool:
        """Whether any sensor is noisy."""
        return any(self.noise)


@inner
def errors(noise, streams, i):
    """The next errors of the sensors, from stream i."""
    return (
        noise[0] * normal(streams, i),
        noise[1] * normal(streams, i),
        noise[2] * normal(streams, i),
        noise[3] * normal(streams, i),
    )


@inner
def machine_at(constants, i):
    """The constants of row i, whether it has its own machine or all rows share one."""
    return constants_of(constants, i if constants.shape[1] > 1 else i - i)  # 0 of i's own type


@inner
def _delay(memory, held, i):
    """Replace the action given now by the one given `delay` intervals ago."""
    length, now = held.shape[0], int(memory[MEMORY.count, i])
    held[now % length, i] = memory[MEMORY.action, i]
    memory[MEMORY.action, i] = held[(now + length - int(memory[MEMORY.delay, i])) % length, i]


@inner
def _push(memory, impulse, p, i):
    """Push row i's hub along the ground; in double stance it tips over one of the feet."""
    phi, shift = memory[MEMORY.phi, i], 0
    theta, dphi, dtheta = memory[MEMORY.theta, i], memory[MEMORY.dphi, i], memory[MEMORY.dtheta, i]
    if memory[MEMORY.mode, i] == DOUBLE and impulse < 0.0:
        phi, shift = p.b, -1
    before = kinetic_energy(phi, theta, dphi, dtheta, p)
    dphi, dtheta = push(phi, theta, dphi, dtheta, impulse, 0.0, p)
    memory[MEMORY.mode, i], memory[MEMORY.phi, i] = SINGLE, phi
    memory[MEMORY.foot, i] += shift
    memory[MEMORY.dphi, i], memory[MEMORY.dtheta, i] = dphi, dtheta
    memory[MEMORY.push_work, i] = kinetic_energy(phi, theta, dphi, dtheta, p) - before
    memory[MEMORY.push_shift, i] = shift


@cached(nogil=True)
def disturb_rows(memory, constants, streams, held, settings, first, last):
    """Before the interval: delay the actions, and push.

    `held` (longest delay + 1, N) keeps actions until they take effect.
    """
    for i in range(first, last):
        _delay(memory, held, i)
        memory[MEMORY.push_work, i] = memory[MEMORY.push_shift, i] = 0.0
        if settings.push_chance > 0.0 and next_uniform(streams, i) < settings.push_chance:
            impulse = between(settings.least_impulse, settings.greatest_impulse, streams, i)
            if next_uniform(streams, i) < 0.5:
                impulse = -impulse
            if impulse != 0.0:
                _push(memory, impulse, machine_at(constants, i), i)


@cached(nogil=True)
def observe_noisily(observations, width, memory, streams, noise, first, last):
    """After the interval: observe again with the sensors' errors, still within bounds."""
    for i in range(first, last):
        observe_row(memory, errors(noise, streams, i), observations, np.uint64(width), np.uint64(i))
