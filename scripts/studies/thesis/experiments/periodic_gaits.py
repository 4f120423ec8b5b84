"""The thesis's aim: steps that repeat, with real collisions and the least electrical energy.

The motor is on the wheel, touchdowns are plastic, the ground only pushes and holds by friction, and
the battery takes nothing back. These are the gaits of `trajopt.periodic_gait`, but the pendulum's
mass is chosen too.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property

import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import Design
from trajopt.gaits.periodic import periodic_gait
from trajopt.gaits.problem import designed_gait
from trajopt.gaits.solution import Solution
from trajopt.ocp.extremal import Extremal
from trajopt.ocp.multi_start import Start
from trajopt.ocp.problem import Problem

#: Of the gaits: m/s, and steps per stride.
SPEED, STEPS = 0.5, 2


def rod_of_mass(params: WheelParams) -> Design:
    """m2 as a design variable, with the inertia in proportion: a denser rod of the same length."""
    ratio = params.pendulum_inertia / params.pendulum_mass
    return Design(("m2",), lambda p: {"pendulum_mass": p[0], "pendulum_inertia": ratio * p[0]})


def cheapest_gait(params: WheelParams, mass: tuple[float, float], turns: int) -> Problem:
    """The problem of a gait of least cost of transport (E+) with m2 to be chosen.

    Args:
        params: the machine.
        mass: bounds on m2 (kg).
        turns: of the pendulum per stride.
    """
    duration = STEPS * params.step_length / SPEED
    return designed_gait(
        *(params, rod_of_mass(params), {"m2": mass}),
        steps=STEPS,
        duration=duration,
        theta_turns=turns,
    )


@dataclasses.dataclass(frozen=True)
class FromGait:
    """Starts from the cheapest gait of the machine as it is; the first has its m2, others any m2.

    Attributes:
        params: the machine.
        mass: bounds on m2 (kg).
    """

    params: WheelParams
    mass: tuple[float, float]

    @cached_property
    def gait(self) -> Solution:
        """The cheapest gait of the machine as it is."""
        return periodic_gait(self.params, SPEED, STEPS)

    def __call__(self, rng: np.random.Generator, index: int) -> Start:
        """Start number `index`."""
        mass = self.params.pendulum_mass if index == 0 else rng.uniform(*self.mass)
        return Start(tuple(self.gait.phases), np.array([mass]))

    def problem(self, before: Extremal | None = None) -> Problem:
        """The problem with the gait's number of turns of the pendulum."""
        return cheapest_gait(self.params, self.mass, self.gait.theta_turns)

    def itself(self, problem: Problem) -> FromGait:
        """This family, whatever the problem."""
        return self
