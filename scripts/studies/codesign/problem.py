"""The gait of least cost of transport of a build: bob, arm and speed are chosen with it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from rimless_gym.params import WheelParams
from scripts.studies.codesign.budget import BOB_RADIUS, CLAMP, TUBE, Build
from trajopt.gaits.problem import designed_gait
from trajopt.ocp.constraints import Constraint
from trajopt.ocp.problem import Phase, Problem

#: Bounds on speed (m/s), bob (kg) and arm (m).
SPEEDS, LIGHTEST_BOB, SHORTEST_ARM = (0.3, 1.2), 0.3, 0.08

#: What the study asks of a gait beyond the preset's limits: least normal force (weights), and the
#: largest friction demand.
NORMAL_FORCE, FRICTION_DEMAND = 0.15, 0.75

#: Largest torque that holds the pendulum level, as a share of what the motor can give: a machine
#: that cannot lift its pendulum has to pump it up, and often fails to.
LIFTED_SHARE = 0.8

#: A bound of zero width has no interior; values that are given are met to so much.
GIVEN = 1e-6


@dataclasses.dataclass(frozen=True)
class Case:
    """What one gait of the study is to be.

    Attributes:
        build: motor, gearhead and legs.
        turns: of theta per step.
        bob, arm: kg and m; chosen where None.
        lifts: whether the motor must be able to lift the pendulum, with a margin.
    """

    build: Build
    turns: int = -1
    bob: float | None = None
    arm: float | None = None
    lifts: bool = True

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """On the design variables.

        Raises:
            ValueError: the bob is too heavy or the arm too long for the build.
        """
        limits = {
            "bob": (LIGHTEST_BOB, self.build.heaviest_bob, self.bob),
            "arm": (SHORTEST_ARM, self.build.longest_arm, self.arm),
        }
        for name, (low, high, given) in limits.items():
            if given is not None and not low <= given <= high:
                raise ValueError(
                    f"{name} = {given}: must be from {low:.3g} to {high:.3g} with "
                    f"{self.build.n_legs} legs"
                )
        return {
            name: (low, high) if given is None else (given - GIVEN, given + GIVEN)
            for name, (low, high, given) in limits.items()
        }

    def problem(self) -> Problem:
        """The problem of one periodic step at any speed; cases of a build share its functions."""
        ring = _ring(self.build, self.lifts)
        link = dataclasses.replace(ring.linkages[0], offset={"theta": -2 * math.pi * self.turns})
        return dataclasses.replace(ring, linkages=(link,), parameters=self.bounds)


def chosen(params: WheelParams) -> tuple[float, float]:
    """Bob (kg) and arm (m) of a machine of the study."""
    given = params.pendulum_reach
    arm = (2 * params.pendulum_length if given is None else given) - BOB_RADIUS
    return params.pendulum_mass - CLAMP - TUBE * arm, arm


def regenerating(problem: Problem) -> Problem:
    """The problem with E in place of E+, whose landscape is smoother."""
    phases = tuple(dataclasses.replace(phase, floor=-math.inf) for phase in problem.phases)
    return dataclasses.replace(problem, phases=phases)


@lru_cache(maxsize=4)
def _ring(build: Build, lifts: bool) -> Problem:
    machine = build.machine(1.0, SHORTEST_ARM).replace(friction=FRICTION_DEMAND)
    slow, fast = SPEEDS
    ring = designed_gait(
        *(machine, build.design, {"bob": (0.1, 10.0), "arm": (0.01, 1.0)}),
        steps=1,
        duration=(machine.step_length / fast, machine.step_length / slow),
        theta_turns=-1,  # a link with an offset, which a case replaces
    )
    return dataclasses.replace(ring, phases=(_with_margins(ring.phases[0], build, lifts),))


def _with_margins(stance: Phase, build: Build, lifts: bool) -> Phase:
    path, at_end = stance.path, stance.at_end
    assert path is not None
    assert at_end is not None
    least = np.array([NORMAL_FORCE, *path.lower[1:]])
    stance = dataclasses.replace(stance, path=dataclasses.replace(path, lower=least))
    if not lifts:
        return stance
    strength = build.lifting_torque()

    def lifted(x: Any, p: Any) -> Any:
        torque = build.holding_torque(ca.vertsplit(p))
        return ca.vertcat(at_end.function(x, p), torque / strength)

    constraint = Constraint(
        lifted,
        np.append(at_end.lower, 0.0),
        np.append(at_end.upper, LIFTED_SHARE),
        (*at_end.names, "torque that lifts the pendulum"),
    )
    return dataclasses.replace(stance, at_end=constraint)


def neighbours(case: Case, cases: Sequence[Case]) -> list[Case]:
    """The cases that differ from one by the next gearhead, number of legs, bob or arm."""

    def place(each: Case) -> tuple[float, ...]:
        own = each.build
        return (own.n_legs, own.gearhead.ratio, each.bob or 0.0, each.arm or 0.0)

    near = []
    for i in range(4):
        alike = [c for c in cases if _but(place(c), i) == _but(place(case), i) and c != case]
        above = sorted(
            (c for c in alike if place(c)[i] > place(case)[i]), key=lambda c: place(c)[i]
        )
        below = sorted(
            (c for c in alike if place(c)[i] < place(case)[i]), key=lambda c: place(c)[i]
        )
        near += above[:1] + below[-1:]
    return near


def _but(values: tuple[float, ...], i: int) -> tuple[float, ...]:
    return values[:i] + values[i + 1 :]
