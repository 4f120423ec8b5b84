"""The equations' shorthand: constants in the thesis's notation, from the fields of a machine."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from rimless_gym.equations import IMPACT_LAWS


class Constants(NamedTuple):
    """The constants in the equations, in the thesis's notation (3.22-3.25).

    It is a tuple of plain scalars, so that numba compiles functions of it and CasADi can put
    symbols in it. Not in the thesis: ``S1`` and ``S2`` are the first moments of mass (m1+m2) L1 and
    m2 L2, ``Jr`` the rotor's inertia at the hub, ``mobility`` 1 / (Je2 + Jr), ``d1`` the motor
    mount (1: stator on the wheel, 0: stator on a frame that does not turn), ``G`` 1 / Rm, ``F0``,
    ``c`` and ``w`` the dry friction at the hub, its share of the gear's torque and its width,
    ``Cd`` the air drag's torque on the leg per phi'^2, ``(gx, -gy)`` gravity in the ground's frame,
    ``chord`` the distance between feet, ``law`` the index of the impact law in `IMPACT_LAWS`.
    """

    m1: Any
    m2: Any
    I1: Any
    L1: Any
    L2: Any
    reach: Any
    S1: Any
    S2: Any
    Je1: Any
    Je2: Any
    Je3: Any
    Jr: Any
    mobility: Any
    d1: Any
    K: Any
    Rm: Any
    G: Any
    damping: Any
    F0: Any
    c: Any
    w: Any
    Cd: Any
    gx: Any
    gy: Any
    alpha: Any
    a: Any
    b: Any
    chord: Any
    law: Any


N_CONSTANTS = len(Constants._fields)


def weight_of(params: Any) -> Any:
    """``(m1 + m2) g`` (N) of anything with the fields of `WheelParams`; numba compiles it too."""
    return (params.wheel_mass + params.pendulum_mass) * params.gravity


def leg_angle_of(params: Any) -> Any:
    """``alpha = 2 pi / n`` (rad) of anything with an ``n_legs``; numba compiles it too."""
    return 2 * math.pi / params.n_legs


def step_length_of(params: Any) -> Any:
    """``2 L1 sin(alpha / 2)`` (m) between neighbouring feet; numba compiles it too."""
    return 2 * params.leg_length * math.sin(leg_angle_of(params) / 2)


def reach_of(params: Any) -> Any:
    """How far the pendulum reaches from the hub (m); numba compiles it too."""
    given = params.pendulum_reach
    return rod_reach(params) if given is None else given


def rod_reach(params: Any) -> Any:
    """How far a pendulum without a `pendulum_reach` of its own reaches, as a uniform rod (m)."""
    return 2 * params.pendulum_length


def shorthand(
    params: Any,
    sin: Callable[[Any], Any] = math.sin,
    cos: Callable[[Any], Any] = math.cos,
) -> Constants:
    """The constants of `params`, whose fields may be CasADi symbols.

    A symbolic slope needs CasADi's `sin` and `cos`.
    """
    d1 = 1.0 if params.motor_mount == "wheel" else 0.0
    return constants_of(params, d1, float(IMPACT_LAWS.index(params.impact_law)), sin, cos)


def constants_of(
    params: Any, d1: Any, law: Any, sin: Callable[[Any], Any], cos: Callable[[Any], Any]
) -> Constants:
    """`shorthand` with the motor mount and the impact law as numbers; numba compiles it too."""
    m1, m2, L1, L2 = (
        params.wheel_mass,
        params.pendulum_mass,
        params.leg_length,
        params.pendulum_length,
    )
    alpha = leg_angle_of(params)
    Je2, Jr = m2 * L2**2 + params.pendulum_inertia, params.rotor_inertia * params.gear_ratio**2
    return Constants(
        m1=m1,
        m2=m2,
        I1=params.wheel_inertia,
        L1=L1,
        L2=L2,
        reach=reach_of(params),
        S1=(m1 + m2) * L1,
        S2=m2 * L2,
        Je1=(m1 + m2) * L1**2 + params.wheel_inertia,
        Je2=Je2,
        Je3=m2 * L1 * L2,
        Jr=Jr,
        mobility=1 / (Je2 + Jr),
        d1=d1,
        K=params.motor_constant * params.gear_ratio,
        Rm=params.armature_resistance,
        G=1 / params.armature_resistance,
        damping=params.hub_damping,
        F0=params.hub_friction,
        c=params.gear_loss,
        w=params.friction_width,
        Cd=params.drag * L1**3,
        gx=params.gravity * sin(params.slope),
        gy=params.gravity * cos(params.slope),
        alpha=alpha,
        a=(math.pi - alpha) / 2,
        b=(math.pi + alpha) / 2,
        chord=step_length_of(params),
        law=law,
    )
