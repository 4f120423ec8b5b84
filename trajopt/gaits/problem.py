"""The wheel's optimal control problems: its modes as phases, its resets as linkages.

`gait_problem` is the problem of a periodic gait; `WheelPhases` has the phases and linkages of which
any other problem of the wheel is made.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from rimless_gym import hybrid
from rimless_gym.hybrid import MAX_RATE
from rimless_gym.params import WheelParams
from rimless_gym.rules import may_touch
from rimless_gym.symbolic import Design, HybridModel
from trajopt.ocp.constraints import Constraint
from trajopt.ocp.problem import Linkage, Phase, Problem
from trajopt.ocp.trajectory import PhaseTrajectory

STATES = ("phi", "theta", "phi'", "theta'")
CONTROLS = ("V",)

#: Name of the phase in which the wheel stands on two feet.
STANDING = "double stance"

#: Highest degree of the control polynomials. Where the motor coasts, V = K psi' is curved.
CONTROL_DEGREE = 3

#: Least normal force, in weights: feedback could not hold a gait on the brink of lift-off. This is
#: a margin of the design; a walk counts while its foot is pressed down (`rimless_gym.rules`).
MIN_NORMAL_FORCE = 0.05

#: Least phi' just before and just after a touchdown (rad/s), so that the guard is crossed.
MIN_TOUCHDOWN_RATE = 0.01

#: Shortest duration of a phase (s): a tenth of the quickest step of any machine that walks.
SHORTEST_STEP = 0.02

#: Distance that phi keeps from the guards within a step (rad): a graze of 1e-7 rad would be a
#: touchdown.
GUARD_MARGIN = 1e-6


def gait_problem(
    params: WheelParams,
    *,
    speed: float,
    steps: int,
    theta_turns: int = 0,
    regeneration: bool = False,
    double_stance: bool = False,
) -> Problem:
    """The problem of a periodic gait: `steps` single-stance phases in a ring, least energy.

    With `double_stance`, the last step ends on two feet, at rest, and one more phase follows: the
    wheel stands until the voltage lifts it off into the first step.

    Problems of one machine and number of steps differ only in numbers, and share their functions.

    Args:
        params: the machine.
        speed: mean speed along the ground (m/s), imposed through the stride's duration.
        steps: touchdowns per stride.
        theta_turns: whole turns that theta gains in a stride.
        regeneration: whether the battery takes energy back.
        double_stance: whether the wheel stops once in a stride.
    """
    ring = _ring(params, steps, double_stance)
    return posed(ring, params, speed, theta_turns, regeneration)


def posed(
    ring: Problem, params: WheelParams, speed: float, theta_turns: int, regeneration: bool
) -> Problem:
    """A `gait_problem` of the same machine and steps with other numbers; shares its functions."""
    turns = {"theta": -2 * math.pi * theta_turns}
    floor = -math.inf if regeneration else params.idle_power
    return dataclasses.replace(
        ring,
        phases=tuple(dataclasses.replace(phase, floor=floor) for phase in ring.phases),
        linkages=(*ring.linkages[:-1], dataclasses.replace(ring.linkages[-1], offset=turns)),
        duration=sum(phase.name != STANDING for phase in ring.phases) * params.step_length / speed,
    )


@lru_cache(maxsize=8)
def _ring(params: WheelParams, steps: int, double_stance: bool) -> Problem:
    wheel = WheelPhases(params)
    step = wheel.single_stance()
    links = [wheel.touchdown(i, (i + 1) % steps) for i in range(steps)]
    if not double_stance:
        return Problem((step,) * steps, tuple(links))
    stances = [step] * (steps - 1) + [wheel.last_stance()]
    stances[0] = dataclasses.replace(stances[0], start={"phi": params.constants.a, "phi'": 0.0})
    links[-1:] = [wheel.stop(steps - 1, steps), wheel.lift_off(steps, 0)]
    return Problem((*stances, wheel.double_stance()), tuple(links))


class WheelPhases:
    """Phases and linkages of one machine, from which problems are put together.

    Args:
        params: the machine.
        design: what of it is to be chosen, if anything: the problem's static parameters.
        regeneration: whether the battery takes energy back (cost E), or not (E+).
    """

    def __init__(
        self, params: WheelParams, design: Design | None = None, *, regeneration: bool = False
    ) -> None:
        self.params, self.design, self.regeneration = params, design, regeneration
        self.model = HybridModel(params, design)

    def function(self, name: str) -> Callable[..., Any]:
        """A function of the hybrid model, whose last argument is the static parameters."""
        function = self.model.functions[name]
        return function if self.design else lambda *inputs: function(*inputs[:-1])

    def single_stance(self, name: str = "single stance") -> Phase:
        """From one forward touchdown to the next; phi may go backwards in between."""
        c, V = self.params.constants, self.params.voltage_limit
        momentum, touchdown, weight = (
            self.function(n) for n in ("linear_momentum", "touchdown", "weight")
        )

        def impulse(x: Any, p: Any) -> Any:
            after = touchdown(x, p)
            px, py = ca.vertsplit(momentum(after, p) - momentum(x, p))
            mass = weight(x, p) / self.params.gravity
            return ca.vertcat(self.inside_cone(px / mass, py / mass), after[2])

        return Phase(
            name=name,
            states=STATES,
            controls=CONTROLS,
            flow=self.function("flow"),
            powers=self._power,
            floor=self._floor,
            path=self._limits(),
            at_end=Constraint(
                impulse,
                np.array([0.0, 0.0, 0.0, MIN_TOUCHDOWN_RATE]),
                np.full(4, np.inf),
                (
                    "upward touchdown impulse",
                    "friction cone of the touchdown impulse (forward)",
                    "friction cone of the touchdown impulse (backward)",
                    "phi' after touchdown",
                ),
            ),
            bounds=_rates() | {"phi": (c.a + GUARD_MARGIN, c.b - GUARD_MARGIN), "V": (-V, V)},
            start={"phi": c.a, "phi'": (0.0, MAX_RATE)},
            end={"phi": c.b, "phi'": (MIN_TOUCHDOWN_RATE, MAX_RATE)},
            duration=(SHORTEST_STEP, math.inf),
        )

    def last_stance(self, name: str = "last stance") -> Phase:
        """Single stance that ends so slowly that the wheel comes to rest on two feet."""
        c = self.params.constants
        energy = hybrid.REST_ENERGY * c.S1 * self.params.gravity
        slow = math.sqrt(2 * energy / (c.Je1 + c.Jr * c.d1))
        end = {"phi": c.b, "phi'": (0.5 * slow, 0.75 * slow)}
        return dataclasses.replace(self.single_stance(name), at_end=None, end=end)

    def double_stance(self, name: str = STANDING) -> Phase:
        """At rest on two feet, both pressed down; only the pendulum moves, and phi is a."""
        c, V = self.params.constants, self.params.voltage_limit
        guards = self.function("lift_off_guards")

        def pressing(x: Any, u: Any, p: Any) -> Any:
            leading, trailing = ca.vertsplit(guards(x, u, p))
            return ca.vertcat(-leading, trailing)

        # The guards are accelerations of phi (rad/s^2).
        least = MIN_NORMAL_FORCE * self.params.gravity / self.params.leg_length
        names = ("leading foot", "trailing foot")
        return Phase(
            name=name,
            states=STATES,
            controls=CONTROLS,
            flow=self.function("flow_double_stance"),
            powers=self._power,
            floor=self._floor,
            path=Constraint(pressing, np.full(2, least), np.full(2, np.inf), names),
            bounds=_rates() | {"phi": c.a, "phi'": 0.0, "V": (-V, V)},
            duration=(SHORTEST_STEP, math.inf),
        )

    def touchdown(self, source: int, target: int, theta_turns: int = 0) -> Linkage:
        """Forward touchdown, after which `theta_turns` whole turns are subtracted from theta."""
        offset = {"theta": -2 * math.pi * theta_turns} if theta_turns else {}
        return Linkage(source, target, self.function("touchdown"), offset)

    def stop(self, source: int, target: int) -> Linkage:
        """The touchdown that leaves the wheel on two feet; `source` is a `last_stance`."""
        return Linkage(source, target, self.function("stop_on_two_feet"))

    def lift_off(self, source: int, target: int) -> Linkage:
        """The trailing foot leaves the ground; the state does not jump."""
        return Linkage(source, target)

    def inside_cone(self, fx: Any, fy: Any) -> Any:
        """Normal force and distances from the friction cone's two sides; none may be negative."""
        mu = self.params.friction
        return ca.vertcat(fy, mu * fy - fx, mu * fy + fx)

    @property
    def _floor(self) -> float:
        return -math.inf if self.regeneration else self.params.idle_power

    def _power(self, x: Any, u: Any, p: Any) -> Any:
        return self.function("electrical_power")(x, u, p) + self.params.idle_power

    def _limits(self) -> Constraint:
        """The friction cone; and the pendulum's clearance, where it may touch the floor.

        Of a machine that is to be designed, the pendulum is not known here: verification checks it.
        """
        force, weight = self.function("ground_reaction"), self.function("weight")
        height, length = self.function("pendulum_clearance"), self.params.leg_length
        clears = self.design is None and may_touch(self.params)

        def inside(x: Any, u: Any, p: Any) -> Any:
            fx, fy = ca.vertsplit(force(x, u, p) / weight(x, p))
            cone = self.inside_cone(fx, fy)
            return ca.vertcat(cone, height(x, p) / length) if clears else cone

        least = [MIN_NORMAL_FORCE, 0.0, 0.0]
        names = ["normal force", "friction cone (forward)", "friction cone (backward)"]
        if clears:
            least.append(0.0)
            names.append("pendulum's clearance")
        return Constraint(inside, np.array(least), np.full(len(least), np.inf), tuple(names))


def _rates() -> dict[str, float | tuple[float, float]]:
    return {"phi'": (-MAX_RATE, MAX_RATE), "theta'": (-MAX_RATE, MAX_RATE)}


def stands(phase: PhaseTrajectory) -> bool:
    """Whether the wheel stands on two feet in a phase of a gait: its leg does not move."""
    return bool(np.ptp(phase.states[..., 0]) == 0.0)


def fastest_walk(params: WheelParams) -> float:
    """The highest mean speed (m/s) of steps within the rates that are considered."""
    c = params.constants
    return params.step_length / max((c.b - c.a) / MAX_RATE, SHORTEST_STEP)


def fastest_pressed(params: WheelParams) -> float:
    """A mean speed (m/s) above which no gait keeps its feet pressed down; infinite for many.

    In a step the hub rises and falls by L1 (1 - cos(alpha / 2)), and the centre of mass with it,
    but for the largest part that the pendulum can make up. Between its highest point and the
    touchdowns on either side it falls no faster than the least normal force allows, since the
    touchdowns themselves only push it up.
    """
    c = params.constants
    made_up = 2 * c.S2 / (c.m1 + c.m2)
    height = hybrid.hub_position(math.pi / 2, c)[1] - hybrid.hub_position(c.a, c)[1] - made_up
    fall = c.gy - MIN_NORMAL_FORCE * params.gravity
    if height <= 0 or fall <= 0:
        return math.inf if height <= 0 else 0.0
    return params.step_length / (2 * math.sqrt(2 * height / fall))
