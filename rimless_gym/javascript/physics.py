"""The physics as JavaScript: `rimless_gym.equations` and `rimless_gym.hybrid`, traced and printed.

Nothing is written again: the lines that numba compiles and CasADi traces are traced here too. A
machine's constants are an object ``p``, computed from its parameters by the traced `constants_of`,
so that a page can change the machine.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from rimless_gym import constants, hybrid
from rimless_gym.constants import Constants
from rimless_gym.envs import layout as observing
from rimless_gym.equations import IMPACT_LAWS, LOSSES, equations
from rimless_gym.javascript.printing import function_text
from rimless_gym.javascript.tracing import Graph, retold
from rimless_gym.params import CHOICES, WheelParams

#: The equations, and the rules of the hybrid automaton, that the stepper and the page need.
EQUATIONS = (
    *("motor_charge", "motor_current", "motor_voltage", "electrical_power", "relative_rate"),
    *("touchdown_guard", "lift_off_guard", "contact_guard", "ground_reaction", "friction_demand"),
    *("pendulum_clearance", "mechanical_energy", "linear_momentum", "hub_position", "descent"),
)
AUTOMATON = ("after_touchdown", "after_lift_off", "both_feet_press")

#: Numbers of the simulator that the stepper needs too.
LIMITS = (
    *("CONTROL_PERIOD", "MAX_RATE", "MAX_EVENTS"),
    *("OK", "CONTACT_LOST", "RATE_EXCEEDED", "TOO_MANY_EVENTS", "THESIS_BACKWARD", "DIVERGED"),
)

#: Fields of a machine that the JavaScript cannot change: their values are built in.
BUILT_IN = ("n_legs", *CHOICES)


def physics(params: WheelParams) -> str:
    """JavaScript that defines the functions of the model, and `constants(machine)`.

    Args:
        params: the machine. Its number of legs, motor mount and impact law are built in, and
            whether its pendulum's reach follows from its length; all else is read from the
            `machine` object, whose fields are those of `WheelParams`.

    Returns:
        The text of functions that take angles in rad, rates in rad/s, voltage ``u`` in V and
        the constants ``p``. ``motion_single`` and ``motion_double`` return the rates of the state
        and the powers of the `LOSSES`, in this order.
    """
    graph, law = Graph(), float(IMPACT_LAWS.index(params.impact_law))
    machine = Constants(*(graph.symbol("input", f"p.{name}") for name in Constants._fields))
    machine = machine._replace(law=law)
    eq = _equations(graph)
    rules = retold(hybrid, math=_maths(graph), max=graph.function("Math.max"), **vars(eq))
    seen = retold(
        observing,
        **{name: graph.function(f"Math.{name}") for name in ("sin", "cos", "min", "max")},
    )
    functions = [
        *(getattr(eq, name) for name in EQUATIONS),
        *(rules[name] for name in AUTOMATON),
        *_motions(eq),
        seen["observation"],
    ]
    return "\n\n".join(
        [
            "\n".join(f"const {name} = {getattr(hybrid, name)!r};" for name in LIMITS),
            f"const LOSSES = {list(LOSSES)!r};",
            _constants_text(params, law),
            *(_function_text(graph, function, machine) for function in functions),
        ]
    )


def _maths(graph: Graph) -> SimpleNamespace:
    functions = {name: graph.function(f"Math.{name}") for name in ("sin", "cos", "sqrt", "hypot")}
    return SimpleNamespace(pi=math.pi, inf=math.inf, **functions)


def _equations(graph: Graph) -> SimpleNamespace:
    maths = _maths(graph)
    return equations(maths.sin, maths.cos, sqrt=maths.sqrt)


def _motions(eq: SimpleNamespace) -> list[Callable[..., Any]]:
    """The rates of the state and of the energies lost, in either stance mode."""

    def motion(dphi: Any, dtheta: Any, acc: tuple[Any, Any], u: Any, p: Any) -> tuple[Any, ...]:
        dpsi, ddpsi = eq.relative_rate(dphi, dtheta, p), eq.relative_rate(*acc, p)
        return (dphi, dtheta, *acc, *tuple(eq.losses(dphi, dpsi, ddpsi, u, p)))

    def motion_single(phi, theta, dphi, dtheta, u, p):  # type: ignore[no-untyped-def]
        return motion(dphi, dtheta, eq.single_stance(phi, theta, dphi, dtheta, u, p), u, p)

    def motion_double(phi, theta, dphi, dtheta, u, p):  # type: ignore[no-untyped-def]
        standing = eq.double_stance(phi, theta, dphi, dtheta, u, p)
        return motion(dphi, dtheta, (0.0, standing), u, p)

    return [motion_single, motion_double]


def _function_text(graph: Graph, function: Callable[..., Any], machine: Constants) -> str:
    names = list(inspect.signature(function).parameters)
    inputs = [machine if name == "p" else graph.symbol("input", name) for name in names]
    return function_text(function.__name__, names, graph.trace(function, *inputs))


def _constants_text(params: WheelParams, law: float) -> str:
    """The function from a machine's fields to its constants."""
    graph, values = Graph(), params.to_dict()
    fixed = [name for name in values if name in BUILT_IN or values[name] is None]
    fields = {n: v if n in fixed else graph.symbol("input", f"m.{n}") for n, v in values.items()}
    maths, d1 = _maths(graph), 1.0 if params.motor_mount == "wheel" else 0.0

    def found(machine: Any) -> Any:
        return constants.constants_of(machine, d1, law, maths.sin, maths.cos)

    return function_text("constants", ["m"], graph.trace(found, SimpleNamespace(**fields)))
