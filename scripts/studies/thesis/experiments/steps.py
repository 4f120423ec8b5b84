"""The thesis's steps as phases, joined by its impact laws, and the least that a step needs."""

from __future__ import annotations

import dataclasses
from typing import Any

import casadi as ca
import numpy as np

from rimless_gym.params import WheelParams
from rimless_gym.symbolic import Design
from scripts.studies.thesis.experiments.tables import Table, Weights
from trajopt.gaits.problem import CONTROLS, GUARD_MARGIN, STATES, WheelPhases
from trajopt.ocp.arrays import Array
from trajopt.ocp.constraints import Bounds, Constraint
from trajopt.ocp.problem import Phase, Problem

#: m2 alone: the thesis's I2 does not depend on it.
PENDULUM_MASS = Design.of("pendulum_mass")

#: No running cost.
NOTHING = Weights(0.0, 0.0, 0.0, 0.0, 0.0)


def steps(
    params: WheelParams,
    table: Table,
    weights: Weights,
    count: int = 1,
    *,
    mass: tuple[float, float] | None = None,
    contact: bool = False,
) -> Problem:
    """Steps one after the other as the thesis poses them, joined by the impact law of `params`.

    Args:
        params: the machine.
        table: bounds; those at the start apply to the first step, those at the end to the last.
        weights: of the cost.
        count: number of steps.
        mass: bounds on m2 (kg) if it is to be chosen; its inertia I2 stays as it is.
        contact: whether the ground can only push, and only within the friction cone; the thesis's
            foot is a pin joint.
    """
    wheel = WheelPhases(params, PENDULUM_MASS if mass else None)
    phases = [step(wheel, table, weights, i, count, contact=contact) for i in range(count)]
    parameters: Bounds = {"m2": mass} if mass else {}
    linkages = tuple(wheel.touchdown(i, i + 1) for i in range(count - 1))
    return Problem(tuple(phases), linkages, parameters, table.duration)


def step(
    wheel: WheelPhases,
    table: Table,
    weights: Weights,
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
