"""The machine's parameters, one frozen dataclass, and the constants in the equations."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import SMALLEST, real
from rimless_gym.equations import IMPACT_LAWS, equations

MOTOR_MOUNTS = ("wheel", "frame")
#: The fields that are names; all others are numbers.
CHOICES = {"motor_mount": MOTOR_MOUNTS, "impact_law": IMPACT_LAWS}
MOST_LEGS = 1_000_000  # the model still tells legs apart that are this close
LEAST_REGULARITY = 1e-12  # of the mass matrix, below which it counts as singular
POSITIVE = (
    *("leg_length", "gear_ratio", "armature_resistance", "friction_width"),
    *("gravity", "voltage_limit"),
)
SIGNED = ("slope", "n_legs")  # neither need be at least 0 here: they have limits of their own

#: Fields that follow from others where the pendulum's shape is known, which it is not here.
FOLLOWING = {
    "pendulum_inertia": ("pendulum_mass", "pendulum_length"),
    "pendulum_reach": ("pendulum_length",),
}

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)


@dataclasses.dataclass(frozen=True, kw_only=True)
class WheelParams:
    """Physical parameters of the actuated rimless wheel, in SI units and radians.

    The fields' defaults are `BUILDABLE`, as everywhere. No number may exceed 1e30 in size.
    Numbers that must be greater than 0, and the sum of the masses, must be at least 1e-30.

    Args:
        wheel_mass: ``m1`` (kg), >= 0.
        wheel_inertia: ``I1`` about the hub (kg m^2), >= 0.
        leg_length: ``L1`` (m), > 0.
        n_legs: ``n``, an integer >= 3, at most a million.
        pendulum_mass: ``m2`` (kg), >= 0.
        pendulum_inertia: ``I2`` about the pendulum's centre of mass (kg m^2), >= 0. It does not
            follow the mass and the length; `replace` warns of it.
        pendulum_length: ``L2``, pivot to centre of mass (m), >= 0.
        pendulum_reach: pivot to the pendulum's far end (m), >= ``L2``; None: ``2 L2``, a rod.
        motor_constant: ``Km`` (N m/A), >= 0; 0 is a wheel without a motor.
        gear_ratio: ``N``, > 0.
        armature_resistance: ``Rm`` (ohm), > 0.
        rotor_inertia: ``Jm`` at the motor shaft (kg m^2), >= 0; the hub feels ``Jm N^2``.
        hub_damping: viscous friction torque per unit of psi' (N m s), >= 0.
        hub_friction: dry friction of motor, gear and bearings at the hub without load (N m), >= 0.
        gear_loss: share of a large transmitted torque that the gear loses, in [0, 1): one less
            its efficiency. It needs hub_friction > 0: such a gear has friction without load too.
        friction_width: |psi'| up to which dry friction is nearly viscous (rad/s), > 0; at three
            times this rate it has 95 % of its size.
        drag: air drag force per squared hub speed (N s^2/m^2), >= 0.
        pendulum_drag: torque of the air on the turning pendulum per theta'^2 (N m s^2), >= 0.
        idle_power: drawn from the battery at all times (W), >= 0.
        gravity: acceleration (m/s^2), > 0.
        slope: ``gamma``, downhill positive, in (-pi/2, pi/2).
        friction: coefficient of the ground, >= 0; a higher demand is reported and, in the
            environment, penalised, but no foot slips.
        voltage_limit: largest |V| (V), > 0.
        motor_mount: ``"wheel"`` (the machine) or ``"frame"`` (the thesis's simulations).
        impact_law: ``"plastic"``, ``"relabel"`` (the thesis's "perfectly elastic"), or
            ``"thesis"`` (equation 3.82 as printed: not physical, it creates energy).

    Raises:
        ValueError: a value is out of its range or the mass matrix would be singular.
        TypeError: a value is not a number.
    """

    wheel_mass: float = 1.39
    wheel_inertia: float = 0.0246
    leg_length: float = 0.3
    n_legs: int = 7
    pendulum_mass: float = 1.61
    pendulum_inertia: float = 0.0014
    pendulum_length: float = 0.142
    pendulum_reach: float | None = 0.167
    motor_constant: float = 0.0229
    gear_ratio: float = 20.95
    armature_resistance: float = 1.9
    rotor_inertia: float = 9.6e-7
    hub_damping: float = 0.0
    hub_friction: float = 0.0212
    gear_loss: float = 0.07
    friction_width: float = 0.1
    drag: float = 0.0
    pendulum_drag: float = 0.0
    idle_power: float = 0.5
    gravity: float = 9.81
    slope: float = 0.0
    friction: float = 0.8
    voltage_limit: float = 12.0
    motor_mount: str = "wheel"
    impact_law: str = "plastic"

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if name in CHOICES:
                if value not in CHOICES[name]:
                    raise ValueError(f"{name} = {value!r}: choose from {CHOICES[name]}")
            elif name != "pendulum_reach" or value is not None:
                object.__setattr__(self, name, _checked(name, value))
        if reach_of(self) < self.pendulum_length:
            raise ValueError(
                f"pendulum_reach = {self.pendulum_reach}: must be at least pendulum_length = "
                f"{self.pendulum_length}, the distance of the centre of mass; change both"
            )
        if self.gear_loss >= 1:
            raise ValueError(
                f"gear_loss = {self.gear_loss}: must be less than 1, a share of torque"
            )
        if self.gear_loss > 0 and self.hub_friction < SMALLEST:
            raise ValueError(
                f"hub_friction = {self.hub_friction}: must be greater than 0 with gear_loss = "
                f"{self.gear_loss}, because a gear that loses torque under load also has friction "
                "without load"
            )
        if not (3 <= self.n_legs <= MOST_LEGS and self.n_legs == int(self.n_legs)):
            raise ValueError(
                f"n_legs = {self.n_legs:.15g}: must be an integer of at least 3, and at most "
                f"{MOST_LEGS}"
            )
        object.__setattr__(self, "n_legs", int(self.n_legs))
        if abs(self.slope) >= math.pi / 2:
            raise ValueError(f"slope = {self.slope}: must lie strictly between -pi/2 and pi/2 rad")
        if self.total_mass < SMALLEST:
            raise ValueError(
                f"wheel_mass + pendulum_mass = {self.total_mass:g}: one of them must be greater "
                f"than 0, at least {SMALLEST:g}"
            )
        if self._is_singular():
            raise ValueError(
                "the mass matrix is singular for these masses and inertias: give the pendulum "
                "an inertia (pendulum_inertia > 0, or pendulum_mass and pendulum_length > 0) "
                "and the wheel a mass or an inertia (wheel_mass or wheel_inertia > 0), or lower "
                "rotor_inertia or gear_ratio: the hub feels "
                f"{self.rotor_inertia * self.gear_ratio**2:.3g} kg m^2"
            )

    def _is_singular(self) -> bool:
        """Whether the mass matrix in single stance is (nearly) singular, with or without rotor."""
        pendulum = self.pendulum_mass * self.pendulum_length**2 + self.pendulum_inertia
        if pendulum + self.rotor_inertia * self.gear_ratio**2 < SMALLEST**4:
            return True
        return bool(_eq.least_regularity(self.constants) <= LEAST_REGULARITY)

    @property
    def total_mass(self) -> float:
        """``m1 + m2`` (kg)."""
        return self.wheel_mass + self.pendulum_mass

    @property
    def weight(self) -> float:
        """``(m1 + m2) g`` (N)."""
        return float(weight_of(self))

    @property
    def leg_angle(self) -> float:
        """``alpha = 2 pi / n`` between neighbouring legs (rad)."""
        return float(leg_angle_of(self))

    @property
    def step_length(self) -> float:
        """Distance between neighbouring feet (m)."""
        return float(step_length_of(self))

    @cached_property
    def constants(self) -> Constants:
        """The equations' shorthand as plain floats."""
        return shorthand(self)

    @cached_property
    def constants_array(self) -> NDArray[np.float64]:
        """`constants` as a read-only float64 array of shape (N_CONSTANTS,)."""
        array = np.array(self.constants, dtype=np.float64)
        array.setflags(write=False)
        return array

    @cached_property
    def motor_pole(self) -> float:
        """Fastest rate (1/s) at which back-EMF and viscous friction damp psi', over all poses."""
        return float(_eq.hub_pole(self.constants))

    def replace(self, /, **changes: Any) -> WheelParams:
        """A copy with some fields changed, validated like a new one.

        Warns:
            UserWarning: the pendulum's mass or length changes, and its inertia or reach, which
                follow from its shape, are not given.

        Raises:
            ValueError: a name is not a field, or a value is out of its range.
        """
        known = [field.name for field in dataclasses.fields(self)]
        for name in changes:
            if name not in known:
                raise ValueError(f"{name!r} is not a field of WheelParams: choose from {known}")
        changed = dataclasses.replace(self, **changes)
        stale = [
            f"{name} = {getattr(self, name):g}"
            for name, follows in FOLLOWING.items()
            if name not in changes
            and getattr(self, name)
            and any(getattr(self, each) != getattr(changed, each) for each in follows)
        ]
        if stale:
            text = f"{' and '.join(stale)}: as before the change of the pendulum; give these, too"
            warnings.warn(text, stacklevel=2)
        return changed

    def differences(self, other: WheelParams) -> dict[str, str]:
        """What differs from another machine, by field: "value (not the other's)"."""
        here, there = self.to_dict(), other.to_dict()
        return {k: f"{here[k]} (not {there[k]})" for k in here if here[k] != there[k]}

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain JSON values; ``WheelParams(**d)`` is the inverse."""
        return dataclasses.asdict(self)


def _checked(name: str, value: Any) -> float:
    number = real(name, value)
    if name in POSITIVE and number < SMALLEST:
        raise ValueError(f"{name} = {number}: must be greater than 0, at least {SMALLEST:g}")
    if name not in SIGNED and number < 0:
        raise ValueError(f"{name} = {number}: must be at least 0")
    return number


class Constants(NamedTuple):
    """The constants in the equations, in the thesis's notation (3.22-3.25).

    It is a tuple of plain scalars, so that numba compiles functions of it and CasADi can put
    symbols in it. Not in the thesis: ``S1`` and ``S2`` are the first moments of mass (m1+m2) L1 and
    m2 L2, ``Jr`` the rotor's inertia at the hub, ``mobility`` 1 / (Je2 + Jr), ``d1`` the motor
    mount (1: stator on the wheel, 0: stator on a frame that does not turn), ``G`` 1 / Rm, ``F0``,
    ``c`` and ``w`` the dry friction at the hub, its share of the gear's torque and its width,
    ``Cd`` and ``Cp`` the air's torques on leg and pendulum per squared rate, ``(gx, -gy)`` gravity
    in the ground's frame, ``chord`` the distance between feet, ``law`` the index of the impact law
    in `IMPACT_LAWS`.
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
    Cp: Any
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
        Cp=params.pendulum_drag,
        gx=params.gravity * sin(params.slope),
        gy=params.gravity * cos(params.slope),
        alpha=alpha,
        a=(math.pi - alpha) / 2,
        b=(math.pi + alpha) / 2,
        chord=step_length_of(params),
        law=law,
    )
