"""The thesis's bounds (tables 4.3 to 4.7) and costs (4.3 to 4.12), in SI units and radians."""

from __future__ import annotations

import dataclasses
from math import pi
from typing import Any

import casadi as ca
import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import Design
from trajopt.gaits.problem import CONTROLS, GUARD_MARGIN, STATES, WheelPhases
from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import Bounds, Constraint
from trajopt.ocp.problem import Phase, Problem

#: Least phi' at the end of the last step (rad/s), where the thesis asks for more than 0.
LEAST_TOUCHDOWN_RATE = 0.01

#: Bounds at the start, throughout, and at the end.
Rows = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


def symmetric(start: float, along: float, end: float) -> Rows:
    """[-x, x] for each x: most bounds of the thesis are symmetric."""
    return (-start, start), (-along, along), (-end, end)


@dataclasses.dataclass(frozen=True)
class Table:
    """Bounds of one of the tables 4.3, 4.4, 4.5 and 4.7."""

    rate: Rows  # of phi' (rad/s)
    swing: Rows  # of theta' (rad/s)
    pendulum: float  # largest |theta| (rad)
    voltage: float  # largest |V| (V)
    duration: tuple[float, float]  # of the whole motion (s)

    def row(self, where: int) -> dict[str, float | tuple[float, float]]:
        """Bounds on the rates and theta at the start (0), throughout (1) or at the end (2)."""
        theta = (-self.pendulum, self.pendulum)
        return {"theta": theta, "phi'": self.rate[where], "theta'": self.swing[where]}


@dataclasses.dataclass(frozen=True)
class CostWeights:
    """A running cost: weights on the squares of phi, phi', theta, theta' and V."""

    phi: float
    rate: float
    theta: float
    swing: float
    voltage: float

    def __call__(self, x: Any, u: Any, p: Any) -> Any:
        """The running cost."""
        states = self.phi, self.theta, self.rate, self.swing  # in the order of `STATES`
        return sum(w * x[i] ** 2 for i, w in enumerate(states)) + self.voltage * u[0] ** 2


WIDE = (-2 * pi, 4 * pi)
TABLE_4_3 = Table(
    rate=((0.0, pi), WIDE, WIDE),
    swing=symmetric(3 * pi, 3 * pi, 3 * pi),
    pendulum=2 * pi,
    voltage=20.0,
    duration=(0.1, 100.0),
)
TABLE_4_4 = dataclasses.replace(
    TABLE_4_3, rate=((0.0, pi), WIDE, (0.0, 0.0)), swing=symmetric(8 * pi, 8 * pi, 3 * pi)
)
TABLE_4_5 = Table(
    rate=((0.5, 2.5), (-5.0, 10.0), (LEAST_TOUCHDOWN_RATE, 10.0)),
    swing=symmetric(8.0, 8.0, 8.0),
    pendulum=2 * pi,
    voltage=20.0,
    duration=(0.1, 100.0),
)
TABLE_4_7 = Table(
    rate=((0.5, 10.0), (-5.0, 10.0), (LEAST_TOUCHDOWN_RATE, 10.0)),
    swing=symmetric(15.0, 15.0, 15.0),
    pendulum=5 * pi,
    voltage=65.0,
    duration=(0.1, 12.0),
)

#: phi, phi', theta, theta', V
COST_4_3 = CostWeights(0.0, 0.0, 0.0, 0.0, 1.0)
COST_4_4 = CostWeights(0.01, 0.01, 0.01, 0.1, 100.0)
COST_4_5 = CostWeights(0.01, 0.01, 0.01, 0.01, 100.0)
COST_4_6 = CostWeights(0.1, 1.0, 1.0, 1.0, 1.0)
COST_4_7 = CostWeights(0.1, 0.1, 1.0, 1.0, 1.0)
COST_4_8 = CostWeights(0.1, 1.0, 0.1, 1.0, 1.0)
COST_4_9 = CostWeights(0.1, 1.0, 0.1, 0.1, 1.0)
COST_4_12 = CostWeights(1.0, 0.1, 0.1, 0.1, 1.0)


#: m2 alone: the thesis's I2 does not depend on it.
PENDULUM_MASS = Design.of("pendulum_mass")

#: No running cost.
NOTHING = CostWeights(0.0, 0.0, 0.0, 0.0, 0.0)


def steps(
    params: WheelParams,
    table: Table,
    weights: CostWeights,
    count: int = 1,
    *,
    mass: tuple[float, float] | None = None,
    contact: bool = False,
) -> Problem:
    """Steps one after the other as the thesis poses them, joined by the impact law of `params`.

    `mass` bounds m2 (kg) if it is to be chosen; its inertia I2 stays as it is. With `contact` the
    ground can only push, and only within the friction cone; the thesis's foot is a pin joint.
    """
    wheel = WheelPhases(params, PENDULUM_MASS if mass else None)
    phases = [step(wheel, table, weights, i, count, contact=contact) for i in range(count)]
    parameters: Bounds = {"m2": mass} if mass else {}
    linkages = tuple(wheel.touchdown(i, i + 1) for i in range(count - 1))
    return Problem(tuple(phases), linkages, parameters, table.duration)


def step(
    wheel: WheelPhases,
    table: Table,
    weights: CostWeights,
    index: int = 0,
    count: int = 1,
    *,
    contact: bool = False,
) -> Phase:
    """Step number `index` of `count`; see `steps`."""
    c, (shortest, longest) = wheel.params.constants, table.duration
    first, last = index == 0, index == count - 1
    guarded = {"phi": (c.a + GUARD_MARGIN, c.b), "V": (-table.voltage, table.voltage)}
    return Phase(
        name=f"step {index + 1}",
        states=STATES,
        controls=CONTROLS,
        flow=wheel.function("flow"),
        cost=weights,
        path=_contact(wheel) if contact else None,
        at_end=_impulse(wheel) if contact and not last else None,
        bounds={**guarded, **table.row(1)},
        start={"phi": c.a, **table.row(0 if first else 1)},
        end={"phi": c.b, **table.row(2 if last else 1)},
        duration=(shortest / count, longest),
    )


def least_final_swing(params: WheelParams, table: Table) -> Problem:
    """The step within a table's bounds that ends with the slowest pendulum; cost: theta'^2."""
    alone = dataclasses.replace(step(WheelPhases(params), table, NOTHING), cost=None)
    return Problem((alone,), endpoint_cost=lambda starts, ends, durations, p: ends[0][3] ** 2)


def least_pull(params: WheelParams, table: Table) -> Problem:
    """The step whose foot must be held down least; its cost is that force, in weights."""
    wheel = WheelPhases(params)
    force, weight = wheel.function("ground_reaction"), wheel.function("weight")
    held = Constraint(
        lambda x, u, p: force(x, u, p)[1] / weight(x, p) + p[0],
        np.zeros(1),
        np.full(1, np.inf),
        ("normal force and pull",),
    )
    alone = dataclasses.replace(step(wheel, table, NOTHING), cost=None, path=held)
    return Problem(
        (alone,),
        parameters={"pull": (0.0, 100.0)},
        endpoint_cost=lambda starts, ends, durations, p: p[0],
    )


def _contact(wheel: WheelPhases) -> Constraint:
    """The ground can only push, and holds by friction."""
    force, weight = wheel.function("ground_reaction"), wheel.function("weight")

    def cone(x: Any, u: Any, p: Any) -> Any:
        return wheel.inside_cone(*ca.vertsplit(force(x, u, p) / weight(x, p)))

    return _nonnegative(cone, "stance")


def _impulse(wheel: WheelPhases) -> Constraint:
    """The same for the impulse of the touchdown."""
    momentum, touchdown, weight = (
        wheel.function(n) for n in ("linear_momentum", "touchdown", "weight")
    )

    def cone(x: Any, p: Any) -> Any:
        jump = momentum(touchdown(x, p), p) - momentum(x, p)
        return wheel.inside_cone(*ca.vertsplit(wheel.params.gravity * jump / weight(x, p)))

    return _nonnegative(cone, "touchdown")


def _nonnegative(function: Any, where: str) -> Constraint:
    names = ("normal force", "friction cone (forward)", "friction cone (backward)")
    named = tuple(f"{where}: {name}" for name in names)
    return Constraint(function, np.zeros(3), np.full(3, np.inf), named)


def from_state(problem: Problem, start: Array) -> Problem:
    """The problem of a step that begins in a given state."""
    return _changed(problem, start=dict(zip(STATES, start.tolist(), strict=True)))


def towards(problem: Problem, end: Array, duration: float) -> Problem:
    """The problem of a step that ends in a given state at a given time (s)."""
    fixed = _changed(problem, end=dict(zip(STATES, end.tolist(), strict=True)), duration=duration)
    return dataclasses.replace(fixed, duration=duration)


def _changed(problem: Problem, **changes: Any) -> Problem:
    (phase,) = problem.phases
    return dataclasses.replace(problem, phases=(dataclasses.replace(phase, **changes),))
