"""The reference simulator: SciPy's adaptive DOP853, events bracketed on its dense output.

It shares only the equations, guards and reset maps (`rimless_gym.hybrid`) with the stepping
kernel. Its steps, event location and energy integrals are its own, so that each simulator checks
the other. It is slow and exact.
"""

from __future__ import annotations

import bisect
import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba.np.unsafe.ndarray import to_fixed_tuple
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import DOP853

from rimless_gym import hybrid
from rimless_gym.crossings import SAMPLES, first_crossing, with_zeros
from rimless_gym.energy import Ledger
from rimless_gym.equations import DOUBLE, LOSSES, MODE_NAMES, SINGLE, Losses, places, record
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.jit import REFERENCE, cached
from rimless_gym.params import N_CONSTANTS, Constants, WheelParams
from rimless_gym.presets import Machine, as_params
from rimless_gym.trajectory import Arc, Event, Trajectory, validated_start

MAX_STEP = 0.01  # s: short enough that no guard is crossed twice between two samples
RECORDED = 4  # samples per step, from which extreme forces and the clearance are taken

FORWARD, BACKWARD, LIFT_OFF, CONTACT = range(4)  # the guards, in the order of `hybrid.guards`

#: The integrals that follow the state, in the order of `state_rates`: work and losses (J).
Integrals = record("Integrals", ("electrical", "shaft", *LOSSES), __name__)
INTEGRALS = places(Integrals)

Control = Callable[[float, NDArray[np.float64]], float]
Turns = Callable[[int], float]


def _even(k: int) -> float:
    return 0.0


@dataclasses.dataclass
class _Motion:
    """The state of a simulation as it runs."""

    y: NDArray[np.float64]  # state (4) and integrals
    mode: int
    foot: int
    machine: Constants  # on even ground
    turn: Turns
    travel: float = 0.0  # of the stance foot (m)
    descent: float = 0.0  # and what potential energy that took (J)
    arcs: list[Arc] = dataclasses.field(default_factory=list)
    events: list[Event] = dataclasses.field(default_factory=list)
    samples: list[tuple[Any, ...]] = dataclasses.field(default_factory=list)
    collision: float = 0.0
    electrical_positive: float = 0.0
    shaft: float = 0.0

    @property
    def integrals(self) -> Any:
        """The `Integrals` so far."""
        return Integrals(*self.y[4:].tolist())

    def ground(self, behind: int, ahead: int) -> NDArray[np.float64]:
        """The machine's constants with the guards of these pieces of ground."""
        a, b = self.machine.a + self.turn(behind), self.machine.b + self.turn(ahead)
        return np.array(self.machine._replace(a=a, b=b), dtype=np.float64)

    def constants(self) -> NDArray[np.float64]:
        """The machine's constants on the ground where it stands."""
        return self.ground(self.foot - 1, self.foot - 1 if self.mode == DOUBLE else self.foot)

    def stand(self, mode: int, shift: int) -> None:
        """Stand in a mode, on a foot that is `shift` legs forward."""
        turn = self.turn(self.foot + min(shift, 0))
        self.travel += shift * hybrid.foot_travel(turn, self.machine)
        self.descent += shift * hybrid.descent(turn, self.machine)
        self.mode, self.foot = mode, self.foot + shift


def simulate(
    params: Machine,
    x0: ArrayLike,
    control: Control | ArrayLike,
    duration: float,
    *,
    mode: str = "single_stance",
    breakpoints: Sequence[float] = (),
    pull: float = math.inf,
    ground: Turns = _even,
    rtol: float = 3e-14,
    atol: float = 1e-14,
) -> Trajectory:
    """Simulate the wheel from x0 under a control.

    Args:
        params: the machine; a `WheelParams`, a preset's name, or a dictionary of the fields that
            differ from the default.
        x0: (phi, theta, phi', theta') in rad and rad/s, phi in [a, b]; in double stance phi = a.
        control: ``control(t, x)`` -> volts, smooth between breakpoints and events; or an array of
            voltages, each held for 10 ms.
        duration: s, > 0.
        mode: stance mode at the start, "single_stance" or "double_stance".
        breakpoints: times at which the control jumps or kinks.
        pull: largest force (N) with which the ground holds the foot down before contact is lost:
            infinity is the pin joint of the thesis (the smallest normal force is reported), 0 ends
            the simulation at loss of contact.
        ground: by how much (rad) the ground from the k-th foothold to the next is steeper than the
            slope; 0 for k = -1 and 0, on both sides of the foothold where the wheel starts.
        rtol: relative tolerance of the integrator.
        atol: absolute tolerance of the integrator.

    Raises:
        TypeError: the machine is of another type, or x0 does not consist of real numbers.
        ValueError: an argument is out of its range or not finite.
        RuntimeError: more than `hybrid.MAX_EVENTS` events within 10 ms, or a diverging motion.
    """
    params = as_params(params)
    if math.isnan(pull) or pull < 0:
        raise ValueError(f"pull = {pull}: must be at least 0 (N)")
    for name, tolerance in (("rtol", rtol), ("atol", atol)):
        if not (math.isfinite(tolerance) and tolerance > 0):
            raise ValueError(f"{name} = {tolerance}: must be finite and greater than 0")
    if ground(-1) != 0 or ground(0) != 0:
        raise ValueError(f"ground(-1) = {ground(-1)}, ground(0) = {ground(0)}: must be 0 (rad)")
    start, mode_index = validated_start(params, x0, mode)
    law, knots = _control_law(control, duration, breakpoints)
    y = np.concatenate([start, np.zeros(len(Integrals._fields))])
    motion = _Motion(y, mode_index, 0, params.constants, ground)
    failure = None
    for t0, t1 in itertools.pairwise(knots):
        failure = _advance(params, motion, law, t0, t1, pull, rtol, atol)
        if failure is not None:
            break
    return _trajectory(params, motion, failure)


def _control_law(
    control: Control | ArrayLike, duration: float, breakpoints: Sequence[float]
) -> tuple[Control, NDArray[np.float64]]:
    """The control as a function of (t, x), and the times between which it is smooth."""
    if not (math.isfinite(duration) and duration > 0):
        raise ValueError(f"duration = {duration}: must be positive and finite (s)")
    if not np.all(np.isfinite(np.asarray(breakpoints, dtype=np.float64))):
        raise ValueError(f"breakpoints = {breakpoints}: must be finite times (s)")
    inner = [float(t) for t in breakpoints if 0 < t < duration]
    if callable(control):
        return control, np.unique([0.0, *inner, duration])
    held = np.asarray(control, dtype=np.float64)
    if held.ndim != 1:
        raise ValueError(f"control: sampled voltages have shape (N,), not {held.shape}")
    if not np.all(np.isfinite(held)):
        raise ValueError("control: every sampled voltage must be finite")
    if len(held) * CONTROL_PERIOD < duration - 1e-9:
        raise ValueError(
            f"control: {len(held)} samples hold for {len(held) * CONTROL_PERIOD} s, "
            f"less than the duration of {duration} s; give more samples or a shorter duration"
        )
    ticks = (CONTROL_PERIOD * np.arange(1, len(held))).tolist()
    knots = [0.0, *(tick for tick in ticks if tick < duration - 1e-12), *inner, duration]

    def law(t: float, x: NDArray[np.float64]) -> float:
        return float(held[bisect.bisect_right(ticks, t)])

    return law, np.unique(knots)


def _advance(
    params: WheelParams,
    motion: _Motion,
    control: Control,
    t0: float,
    t1: float,
    pull: float,
    rtol: float,
    atol: float,
) -> str | None:
    """Advance over an interval of smooth control; returns the name of a failure, or None."""
    constants, t, first_event = motion.constants(), t0, len(motion.events)
    last = np.nextafter(t1, t0)  # the control may jump at t1: this interval ends just before

    def voltage(time: float, y: NDArray[np.float64]) -> float:
        u = float(control(min(max(time, t0), last), y[:4]))
        if not math.isfinite(u):
            raise ValueError(f"control({time}, {y[:4]}) = {u}: must be a finite voltage")
        return u

    def rates(time: float, y: NDArray[np.float64]) -> tuple[float, ...]:
        u = voltage(time, y)
        smooth, lost = state_rates(motion.mode, y[0], y[1], y[2], y[3], u, constants)
        return *smooth, *lost

    def guards(time: float, y: NDArray[np.float64]) -> tuple[float, ...]:
        u = voltage(time, y)
        return guard_values(motion.mode, y[0], y[1], y[2], y[3], u, pull, constants)

    while t < t1:
        if guards(t, motion.y)[CONTACT] > 0:
            return _lose_contact(motion, t, voltage)
        if motion.mode == DOUBLE and guards(t, motion.y)[LIFT_OFF] > 0:
            _lift_off(motion, t, voltage(t, motion.y))
            constants = motion.constants()
        if len(motion.events) - first_event > hybrid.MAX_EVENTS * math.ceil(
            (t1 - t0) / CONTROL_PERIOD
        ):
            raise RuntimeError(
                f"more than {hybrid.MAX_EVENTS} events per {CONTROL_PERIOD} s near t = {t} s, "
                f"state {motion.y[:4]}: the control chatters; smooth it"
            )
        solver = DOP853(rates, t, motion.y, t1, rtol=rtol, atol=atol, max_step=MAX_STEP)
        _sample(motion, t, motion.y, voltage(t, motion.y))
        event = None
        while solver.status == "running" and event is None:
            message = solver.step()
            if solver.status == "failed" or np.abs(solver.y[2:4]).max() > hybrid.MAX_RATE:
                raise RuntimeError(f"the motion diverges at t = {solver.t} s: {message}")
            dense = solver.dense_output()
            event = first_crossing(guards, dense, solver.t_old, solver.t)
            end = solver.t if event is None else event[1]
            motion.arcs.append(Arc(solver.t_old, end, motion.mode, motion.foot, dense))
            _add_work(motion, params, voltage, motion.arcs[-1])
            motion.y = np.array(solver.y if event is None else dense(end))
            inner = np.linspace(solver.t_old, end, RECORDED + 1)[1:-1]
            for time, y in zip(inner, dense(inner).T, strict=True):
                _sample(motion, float(time), y, voltage(time, y))
            _sample(motion, end, motion.y, voltage(end, motion.y))
        t = t1 if event is None else event[1]
        if event is not None:
            if event[0] in (FORWARD, BACKWARD):  # the control may depend on the contact
                on = Constants(*constants)
                motion.y[0] = on.b if event[0] == FORWARD else on.a
            u = voltage(t, motion.y)
            if event[0] == CONTACT:
                return _lose_contact(motion, t, voltage)
            if event[0] == LIFT_OFF:
                _lift_off(motion, t, u)
            elif not _touch_down(motion, t, 1 if event[0] == FORWARD else -1, u):
                return hybrid.Failure.BACKWARD_TOUCHDOWN_UNDER_THE_THESIS_LAW.name.lower()
            constants = motion.constants()
    return None


def _add_work(motion: _Motion, params: WheelParams, voltage: Control, arc: Arc) -> None:
    """Add max(V i, 0) and |T psi'| over an arc, piece by piece between their changes of sign."""

    p = params.constants

    def factors(times: NDArray[np.float64]) -> NDArray[np.float64]:
        values = []
        for t, y in zip(times, arc.dense(times).T, strict=True):
            u, rate = voltage(t, y), hybrid.relative_rate(y[2], y[3], p)
            values.append((u, hybrid.motor_current(rate, u, p), rate))
        return np.array(values)

    times = with_zeros(factors, np.linspace(arc.start, arc.end, SAMPLES + 1))
    which = [INTEGRALS.electrical, INTEGRALS.shaft]
    electrical, shaft = np.diff(arc.dense(times)[4:][which])
    motion.electrical_positive += float(np.maximum(electrical, 0.0).sum())
    motion.shaft += float(np.abs(shaft).sum())


def _sample(motion: _Motion, t: float, y: NDArray[np.float64], u: float) -> None:
    motion.samples.append((t, y[:4].copy(), motion.mode, motion.foot, u))


def _lose_contact(motion: _Motion, t: float, voltage: Any) -> str:
    x = motion.y[:4].copy()
    motion.events.append(Event("contact_lost", t, 0, x, x, MODE_NAMES[motion.mode]))
    _sample(motion, t, motion.y, voltage(t, motion.y))
    return hybrid.Failure.CONTACT_LOST.name.lower()


def _lift_off(motion: _Motion, t: float, u: float) -> None:
    before = motion.y[:4].copy()
    phi, shift = after_lift_off(before[1], before[3], u, motion.constants())
    motion.y[0], motion.y[2] = phi, 0.0
    motion.stand(SINGLE, shift)
    direction = 1 if shift == 0 else -1
    motion.events.append(
        Event("lift_off", t, direction, before, motion.y[:4].copy(), "single_stance")
    )


def _touch_down(motion: _Motion, t: float, direction: int, u: float) -> bool:
    between = motion.foot if direction > 0 else motion.foot - 1
    constants, descent = motion.ground(between, between), motion.descent
    before = motion.y[:4].copy()
    _sample(motion, t, motion.y, u)
    landing = after_touchdown(direction, *before[1:], u, constants)
    if not landing.legal:
        return False
    after = np.array([landing.phi, before[1], landing.dphi, landing.dtheta])
    motion.y[:4] = after
    motion.stand(landing.mode, landing.shift)
    old, new = (measured(SINGLE, *x, u, constants) for x in (before, after))
    lost = old.energy - new.energy + (motion.descent - descent)
    motion.collision += lost
    impulse = np.subtract(new.momentum, old.momentum)
    motion.events.append(
        Event(
            *("touchdown", t, direction, before, after, MODE_NAMES[landing.mode]),
            float(lost),
            impulse=(float(impulse[0]), float(impulse[1])),
        )
    )
    return True


def _trajectory(params: WheelParams, motion: _Motion, failure: str | None) -> Trajectory:
    _sample(motion, motion.arcs[-1].end if motion.arcs else 0.0, motion.y, motion.samples[-1][4])
    t, x, mode, foot, u = (np.array(column) for column in zip(*motion.samples, strict=True))
    sampled = [
        measured(int(m), *s, v, params.constants_array) for s, m, v in zip(x, mode, u, strict=True)
    ]
    ledger = Ledger(
        time=float(t[-1]),
        distance=float(sampled[-1].hub - sampled[0].hub + motion.travel),
        electrical=motion.integrals.electrical,
        electrical_positive=motion.electrical_positive,
        losses=Losses(*(getattr(motion.integrals, name) for name in LOSSES)),
        collision=float(motion.collision),
        shaft=motion.shaft,
        mechanical_change=float(sampled[-1].energy - sampled[0].energy - motion.descent),
        idle=params.idle_power * float(t[-1]),
    )
    impulses = [event.impulse for event in motion.events if event.kind == "touchdown"]
    return Trajectory(
        params=params,
        t=t,
        x=x,
        mode=mode,
        foot=foot,
        u=u,
        events=tuple(motion.events),
        arcs=tuple(motion.arcs),
        ledger=ledger,
        min_normal_force=min(float(one.force[1]) for one in sampled),
        friction_demand=max(float(one.demand) for one in sampled),
        impulse_friction_demand=max(
            (hybrid.friction_demand(jx, jy) for jx, jy in impulses), default=0.0
        ),
        clearance=min(float(one.clearance) for one in sampled),
        failure=failure,
    )


# The hybrid model's functions for callers in Python take the machine as an array of constants. One
# function computes all the values that callers need together, because every compiled function costs
# a new process some tenths of a second.


@cached()
def state_rates(mode, phi, theta, dphi, dtheta, u, constants):
    """Two tuples: the state's rates with electrical and shaft power, and the losses' powers.

    All are smooth. The shaft power is what the motor delivers to wheel and pendulum.
    """
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    ddphi, ddtheta = hybrid.accelerations(mode, phi, theta, dphi, dtheta, u, p)
    dpsi = hybrid.relative_rate(dphi, dtheta, p)
    electrical, shaft = hybrid.electrical_power(dpsi, u, p), hybrid.shaft_power(dpsi, u, p)
    motion = dphi, dtheta, ddphi, ddtheta, electrical, shaft
    return motion, hybrid.losses(dphi, dpsi, hybrid.relative_rate(ddphi, ddtheta, p), u, p)


@cached(REFERENCE)
def guard_values(mode, phi, theta, dphi, dtheta, u, pull, constants):
    """`hybrid.guards`."""
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    return hybrid.guards(mode, phi, theta, dphi, dtheta, u, pull, p)


class Measured(NamedTuple):
    """What is known of a state at a voltage.

    Attributes:
        force: (Fx, Fy) on the foot, or on both (N).
        demand: the friction coefficient that it needs.
        energy: mechanical, measured from the stance foot (J).
        momentum: (x, y) of the machine (N s).
        hub: its x from the stance foot (m).
        clearance: of the pendulum's end (m).
    """

    force: Any
    demand: Any
    energy: Any
    momentum: Any
    hub: Any
    clearance: Any


@cached()
def measured(mode, phi, theta, dphi, dtheta, u, constants):
    """(Fx, Fy), mechanical energy, momentum, the hub's x and the pendulum's clearance."""
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    ddphi, ddtheta = hybrid.accelerations(mode, phi, theta, dphi, dtheta, u, p)
    force = hybrid.ground_reaction(phi, theta, dphi, dtheta, ddphi, ddtheta, p)
    energy = hybrid.mechanical_energy(phi, theta, dphi, dtheta, p)
    momentum = hybrid.linear_momentum(phi, theta, dphi, dtheta, p)
    hub, clearance = hybrid.hub_position(phi, p)[0], hybrid.pendulum_clearance(phi, theta, p)
    demand = hybrid.friction_demand(force[0], force[1])
    return Measured(force, demand, energy, momentum, hub, clearance)


@cached()
def after_touchdown(direction, theta, dphi, dtheta, u, constants):
    """`hybrid.after_touchdown`."""
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    return hybrid.after_touchdown(direction, theta, dphi, dtheta, u, p)


@cached()
def after_lift_off(theta, dtheta, u, constants):
    """See `Measured`."""
    p = Constants(*to_fixed_tuple(constants, N_CONSTANTS))
    return hybrid.after_lift_off(theta, dtheta, u, p)
