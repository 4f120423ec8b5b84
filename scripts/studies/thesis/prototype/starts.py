"""Starts of the search at one scale: gaits of other scales, then random whirls and swings."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from rimless_gym.params import WheelParams
from scripts.studies.thesis.prototype.variant import GEARS, SPEEDS, Variant
from trajopt.gaits.search import random_guess
from trajopt.gaits.solution import Solution
from trajopt.ocp.guesses import Guess
from trajopt.ocp.multi_start import Start
from trajopt.ocp.problem import Problem

#: Most turns of theta per step, either way: light pendulums whirl.
MOST_TURNS = 8


@dataclasses.dataclass(frozen=True)
class StartsAtScale:
    """A family of starts; the known gaits come first, then random motions.

    Attributes:
        variant: supply and gear.
        scale: of the pendulum.
        known: gaits of other scales.
    """

    variant: Variant
    scale: float
    known: tuple[Solution, ...] = ()

    def __call__(self, rng: np.random.Generator, index: int) -> Start:
        """Start number `index`."""
        if index < len(self.known):
            gait = self.known[index]
            guess, turns = tuple(gait.phases), gait.theta_turns
            _, gear = self.variant.scale_and_gear(gait)
        else:
            guess, turns = whirling(self.variant.params, rng)
            gear = float(np.exp(rng.uniform(np.log(0.1), 1.0)))
        posed = self.variant.problem(self.scale, turns)
        problems = (regenerating(posed), posed) if index >= len(self.known) else (posed,)
        return Start(guess, np.array([self.scale, np.clip(gear, *GEARS)]), problems, str(turns))


def whirling(params: WheelParams, rng: np.random.Generator) -> tuple[Guess, int]:
    """A random step, and its number of turns of theta."""
    slow, fast = SPEEDS
    speed = math.exp(rng.uniform(math.log(1.5 * slow), math.log(fast)))
    duration = params.step_length / speed
    (phase,), _ = random_guess(params, 1, duration, rng)
    turns = int(rng.integers(-MOST_TURNS, MOST_TURNS, endpoint=True))
    states = phase.states.copy()
    missing = 2 * math.pi * turns - (states[-1, -1, 1] - states[0, 0, 1])
    share = np.linspace(0.0, 1.0, states[..., 0].size).reshape(states.shape[:2])
    states[..., 1] += missing * share
    states[..., 3] += missing / phase.duration
    return (dataclasses.replace(phase, states=states),), turns


def regenerating(problem: Problem) -> Problem:
    """The problem with E in place of E+, whose landscape is smoother."""
    phases = tuple(dataclasses.replace(phase, floor=-math.inf) for phase in problem.phases)
    return dataclasses.replace(problem, phases=phases)
