"""One control interval of a wheel in JAX: events located, energy accounted, differentiable.

Every equation, guard and reset map is traced from the lines that numba compiles. Only the numerics
are here: a loop of attempts, each an integration step that ends where accuracy wants it or on an
event. An attempt that ran into an event is repeated with the length at which the event is, by
Newton's method on that length.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jax.lax import stop_gradient
from scipy.integrate import DOP853

from rimless_gym import hybrid
from rimless_gym.equations import DOUBLE, SINGLE, Accelerations, State
from rimless_gym.hybrid import CONTACT_LOST, CONTROL_PERIOD, MAX_EVENTS, MAX_RATE, OK
from rimless_gym.jax.traced import root, traced
from rimless_gym.kernel import attempt
from rimless_gym.kernel.attempt import MAX_POLE_STEP, MAX_RATE_STEP
from rimless_gym.kernel.stepping import HybridState
from rimless_gym.params import Constants


class Numerics(NamedTuple):
    """How motion is integrated, and how near events are located."""

    weights: Any  # the stages' in each next stage, and in the step's end
    length: float  # of steps, in units of the kernel's
    located: float  # Newton's last step (s) to an event; what is left of it is extrapolated


#: By the type of the numbers: DOP853, and Runge and Kutta's classical method.
NUMERICS = {
    "float64": Numerics(np.vstack([DOP853.A[1:], DOP853.B]), 1.0, 1e-9),
    "float32": Numerics(
        np.vstack([np.diag([0.5, 0.5, 1.0, 0.0])[:3], np.array([1, 2, 2, 1]) / 6]), 2.0, 1e-6
    ),
}

#: What a search may be for, besides a touchdown, which is its direction.
NOTHING, LIFT_OFF, RELEASE = map(int, (attempt.NOTHING, attempt.LIFT_OFF, attempt.RELEASE))

FEW, LEVELS = 8, 2  # rows are moved together when this share of them is under way, so many times
MOST_TRIES = 40  # to locate an event

#: Numbers in memory for each row, at least: what XLA wants for a step of walks, with its fusion.
ROW_NUMBERS = 75

#: Most attempts in an interval: an event takes three, and there may be `MAX_EVENTS`.
MOST_ATTEMPTS = 3 * MAX_EVENTS


class Machine(NamedTuple):
    """A machine as the simulator needs it."""

    constants: Constants
    pole: Any  # the motor's (1/s)


class Totals(NamedTuple):
    """What an interval sums up or finds the extreme of, named as in `rimless_gym.energy.ROW`."""

    electrical: Any
    electrical_positive: Any
    min_normal_force: Any
    friction_demand: Any
    impulse_friction_demand: Any
    clearance: Any
    steps: Any
    touchdowns: Any
    touchdown_time: Any
    elapsed: Any
    distance: Any
    failure: Any


class _Search(NamedTuple):
    """The search for an event, over the attempts at one step; see `rimless_gym.kernel.tile`."""

    length: Any
    goal: Any
    low: Any
    high: Any
    before: Any
    miss: Any
    tries: Any
    cut: Any


class _Interval(NamedTuple):
    """The state of an interval under way."""

    y: State
    acc: Accelerations
    mode: Any
    foot: Any
    left: Any
    totals: Totals
    lift: Any  # guards of lift-off and contact, at y
    pull: Any
    events: Any
    attempts: Any
    search: _Search


def advance(
    state: HybridState,
    volts: Any,
    drawn: Mapping[str, Any],
    machine_of: Callable[[Mapping[str, Any]], Machine],
    duration: float,
) -> tuple[HybridState, Totals]:
    """The state after an interval at a constant voltage, and what is measured in it.

    All arrays are scalars; use `jax.vmap`. The interval ends early where the motion fails
    (`Totals.failure`). So does one that runs out of attempts, with `TOO_MANY_EVENTS`.

    Derivatives are found in forward mode, as a matrix: JAX transposes its product for reverse mode.
    So a gradient needs no record of the attempts, and their number no limit.

    Raises:
        MemoryError: the rows do not fit into memory.
    """

    def together(state: HybridState, volts: Any, drawn: Any) -> tuple[HybridState, Totals]:
        _require_memory(volts.size, volts.dtype.itemsize)
        machine = machine_of(drawn)
        run = _begin(state, volts, machine.constants, duration)
        run = _finished(run, volts, machine, duration, LEVELS)
        return _end(state, run, machine, duration)

    moved = jax.custom_batching.custom_vmap(together)

    @moved.def_vmap
    def _(rows: int, batched: Any, *given: Any) -> Any:  # also those of several vmaps together
        given = jax.tree.map(
            lambda x, b: x if b else jnp.broadcast_to(x, (rows, *x.shape)), given, tuple(batched)
        )
        shape = given[1].shape
        out = jax.tree.map(lambda x: x.reshape(shape), moved(*jax.tree.map(jnp.ravel, given)))
        return out, jax.tree.map(lambda _: True, out)

    result = jax.custom_jvp(moved)

    @result.defjvp
    def _(given: Any, changes: Any) -> Any:
        (state, *others), (moves, *changed) = given, changes
        flat, unravel = ravel_pytree((state[:4], *others))
        change, _ = ravel_pytree((moves[:4], *changed))

        def of_numbers(flat: Any) -> Any:
            y, *others = unravel(flat)
            out = together(HybridState(*y, *state[4:]), *others)
            return out, out

        matrices, out = jax.jacfwd(of_numbers, has_aux=True)(flat)
        return out, jax.tree.map(lambda x, matrix: _product(x, matrix, change), out, matrices)

    return result(state, volts, dict(drawn))


def compiler_options() -> dict[str, str]:
    """For `jax.jit` of steps: on a CPU, XLA's fusion would compute what is used twice every time.

    Without it, steps compile in half the time and are two to four times as fast.
    """
    return {"xla_disable_hlo_passes": "fusion"} if jax.default_backend() == "cpu" else {}


def _require_memory(rows: int, size: int) -> None:
    """Refuse rows of numbers of so many bytes that cannot fit, before they take all memory."""
    default = jax.config.jax_default_device  # what is traced has no device yet
    device = default if isinstance(default, jax.Device) else jax.local_devices(backend=default)[0]
    if found := device.memory_stats():
        room = found["bytes_limit"]
    elif hasattr(os, "sysconf"):
        room = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    else:
        return
    if (needed := rows * ROW_NUMBERS * size) > room:
        raise MemoryError(
            f"{rows:,} rows need at least {needed / 1e9:.3g} GB of {room / 1e9:.3g} GB: step fewer "
            "at a time, with jax.lax.map(..., batch_size=...)"
        )


def _product(x: Any, matrix: Any, change: Any) -> Any:
    """The change of a result x; that of an integer has a type of its own."""
    whole = not jnp.issubdtype(x.dtype, jnp.floating)
    return np.zeros(x.shape, jax.dtypes.float0) if whole else matrix @ change


def _finished(run: _Interval, u: Any, machine: Machine, duration: float, levels: int) -> _Interval:
    """All intervals after their last attempts.

    When few rows are under way, they are moved together, so that they do not hold up the others.
    """

    def step(run: _Interval) -> _Interval:
        return _where(_runs(run), _attempt(run, u, machine, duration), run)

    few = u.size // FEW if levels else 0
    run = jax.lax.while_loop(lambda run: jnp.where(_runs(run), 1, 0).sum() > few, step, run)
    if not few:
        return run
    (rows,) = jnp.nonzero(_runs(run), size=few, fill_value=u.size)
    some, u, machine = jax.tree.map(lambda x: x[rows] if jnp.ndim(x) else x, (run, u, machine))
    some = _finished(some, u, machine, duration, levels - 1)
    return jax.tree.map(lambda x, y: x.at[rows].set(y, mode="drop"), run, some)


def _runs(run: _Interval) -> Any:
    """Whether an interval needs another attempt."""
    going = (run.left > 0) & (run.totals.failure == OK)
    return going & (run.attempts < MOST_ATTEMPTS)


def _end(
    state: HybridState, run: _Interval, machine: Machine, duration: float
) -> tuple[HybridState, Totals]:
    """The state and the totals, of an interval after its last attempt."""
    p = machine.constants
    steps = run.foot - state.foot
    travel = traced.hub_position(run.y.phi, p)[0] - traced.hub_position(state.phi, p)[0]
    failure = run.totals.failure
    exhausted = (run.left > 0) & (failure == OK)
    totals = run.totals._replace(
        steps=steps,
        elapsed=duration - run.left,
        distance=travel + steps * p.chord,
        failure=jnp.where(exhausted, hybrid.TOO_MANY_EVENTS, failure),
    )
    return HybridState(*run.y, run.mode, run.foot), totals


def _contact(y: State, acc: Accelerations, p: Constants) -> tuple[Any, Any, Any]:
    """Fy (N), the friction demand and the clearance (m)."""
    fx, fy = traced.ground_reaction(*y, *acc, p)
    return fy, traced.friction_demand(fx, fy), traced.pendulum_clearance(y.phi, y.theta, p)


def _begin(state: HybridState, u: Any, p: Constants, duration: float) -> _Interval:
    """The interval before its first attempt; a foot that would have to be pulled down lifts off."""
    y, mode, zero, p = State(*state[:4]), state.mode, jnp.zeros_like(state.phi), _typed(p, u)
    pull = traced.contact_guard(traced.foot_force(mode, *y, u, p), 0.0)
    lift = traced.lift_off_guard(y.theta, y.dtheta, u, p)
    phi, shift = traced.after_lift_off(y.theta, y.dtheta, u, p)
    lifts = (mode == DOUBLE) & (lift > 0) & (pull <= 0)
    y, mode = y._replace(phi=jnp.where(lifts, phi, y.phi)), jnp.where(lifts, SINGLE, mode)
    acc = traced.accelerations(mode, *y, u, p)
    fy, demand, clearance = _contact(y, acc, p)
    grip = traced.contact_guard(fy, 0.0)
    fast = jnp.maximum(jnp.abs(y.dphi), jnp.abs(y.dtheta))
    failure = jnp.where(fast <= MAX_RATE, OK, hybrid.RATE_EXCEEDED)
    failure = jnp.where((pull > 0) | (grip > 0), CONTACT_LOST, failure)
    none = jnp.zeros_like(state.foot)
    totals = Totals(
        zero, zero, fy, demand, zero, clearance, none, none, zero - 1, zero, zero, failure
    )
    foot, events = state.foot + jnp.where(lifts, shift, 0), none + lifts
    search = _no_search(zero, none)
    return _Interval(y, acc, mode, foot, zero + duration, totals, lift, grip, events, none, search)


def _no_search(zero: Any, none: Any) -> _Search:
    return _Search(zero - 1, none + int(NOTHING), zero, zero, zero, zero, none, none)


def _planned(run: _Interval, u: Any, machine: Machine) -> Any:
    """The longest attempt that accuracy allows; see `rimless_gym.kernel.attempt.plan`."""
    p, y, acc, left = machine.constants, run.y, run.acc, run.left
    length = NUMERICS[str(left.dtype)].length
    rolling = jnp.abs(y.dphi) + 0.5 * left * jnp.abs(acc.ddphi)
    swinging = jnp.abs(y.dtheta) + 0.5 * left * jnp.abs(acc.ddtheta)
    rate = rolling + swinging
    turning = rate / jnp.clip(traced.peak(p), attempt.LEAST_PEAK, 1.0)
    turning = jnp.maximum(turning, traced.swing_frequency(p))
    damping = machine.pole + traced.drag_pole(rolling, swinging, p)
    fastest = jnp.maximum(damping / MAX_POLE_STEP, turning / MAX_RATE_STEP)
    if not _absent(p.F0):
        rubbing = traced.friction_rate(y, acc, jnp.minimum(rate, 2 * MAX_RATE), u, p)
        fastest = jnp.maximum(fastest, rubbing)
    if not _absent(p.Cp):
        fastest = jnp.maximum(fastest, traced.windage_rate(y, acc, p))
    longest = 0.999 * left / CONTROL_PERIOD  # rounding adds no step
    steps = jnp.ceil(jnp.maximum(jnp.maximum(left * fastest / length, longest), 0.5))
    return left / stop_gradient(steps)


def _integrated(
    y: State, acc: Accelerations, mode: Any, h: Any, u: Any, p: Constants
) -> tuple[State, Accelerations]:
    """The state at the end of a step of length h, and the accelerations there."""
    weights = NUMERICS[str(h.dtype)].weights
    stages, twice = len(weights), weights[:, 1:] @ weights[:-1]

    def stage(i: Any, so_far: Any) -> Any:
        rates, _, _ = so_far
        w, w2 = (jnp.asarray(table, h.dtype)[i] for table in (weights, twice))
        x = (
            x + h * (w.sum() * v + h * jnp.tensordot(w2, k, 1))
            for x, v, k in zip(y[:2], y[2:], rates, strict=True)
        )
        v = (v + h * jnp.tensordot(w, k, 1) for v, k in zip(y[2:], rates, strict=True))
        there = State(*x, *v)
        acc = Accelerations(*traced.accelerations(mode, *there, u, p))
        rates = [k.at[(i + 1) % stages].set(a) for k, a in zip(rates, acc, strict=True)]
        return rates, there, acc

    begin = [jnp.zeros((stages, *h.shape), h.dtype).at[0].set(a) for a in acc]
    _, end, acc_end = jax.lax.fori_loop(0, stages, stage, (begin, y, Accelerations(*acc)))
    return end, acc_end


class _Step(NamedTuple):
    """A step that is attempted: its ends, and its length (s)."""

    y: State
    acc: Accelerations
    end: State
    acc_end: Accelerations
    h: Any


class _Arrival(NamedTuple):
    """Where a step ends, or the event near its end that is sought."""

    late: Any  # time from the step's end (s)
    before: State
    after: State
    mode: Any
    shift: Any
    legal: Any
    demand: Any  # of friction, for the impulse
    contact: tuple[Any, Any, Any]
    lift: Any  # guards of lift-off and contact
    pull: Any
    miss: Any  # of the event's guard, at the step's end


def _attempt(run: _Interval, u: Any, machine: Machine, duration: float) -> _Interval:
    """One attempt at a step: accepted, or the search for the event that it ran into set up."""
    p, search = _typed(machine.constants, u), run.search
    h = jnp.where(search.length >= 0, search.length, _planned(run, u, machine))
    step = _Step(run.y, run.acc, *_integrated(run.y, run.acc, run.mode, h, u, p), h)
    arrival = _arrival(run, step, u, p)
    touches, touch_time, touch_high = _touches(step, run.mode, p)
    lifts = (arrival.mode == DOUBLE) & (arrival.lift > 0)
    middle = traced.foot_force(run.mode, *traced.between(*step, 0.5), u, p)
    pull_middle = traced.contact_guard(middle, 0.0)

    searching, located = search.goal != NOTHING, NUMERICS[str(h.dtype)].located
    there = jnp.abs(arrival.late) <= located
    there |= (search.tries >= MOST_TRIES) | (search.high - search.low <= 0.01 * located)
    stands = jnp.where(searching, there, ~(touches | lifts))
    releases = stands & (search.goal != RELEASE) & ((arrival.pull > 0) | (pull_middle > 0))
    sane = jnp.maximum(jnp.abs(step.end.dphi), jnp.abs(step.end.dtheta)) < 10 * MAX_RATE
    accepted = stands & ~releases & sane

    early = releases & (pull_middle > 0)
    high = jnp.where(early, 0.5 * h, h)
    above = jnp.where(early, pull_middle, jnp.where(releases, arrival.pull, arrival.lift))
    below = jnp.where(releases, run.pull, run.lift)
    aims = touches & ~releases
    sought = jnp.where(releases, RELEASE, jnp.where(touches, _nearer(step, p), LIFT_OFF))
    opened = search._replace(
        length=jnp.where(aims, touch_time, high * below / (below - above)),
        goal=sought,
        low=jnp.zeros_like(h),
        high=jnp.where(aims, touch_high, high),
        before=high,
        miss=above,
        tries=0 * search.tries,
    )
    following = _where(releases | ~searching, opened, _narrowed(search, h, arrival))
    if not _absent(p.Cd):  # air drag has a kink: a step ends there
        kink = stands & ~searching & (search.cut == 0)
        kink &= traced.crosses_kink(run.y.dphi, step.end.dphi, p)
        turn = jnp.maximum(traced.reversal(*step) * h, 1e-6 * h)
        following = _where(kink, search._replace(length=turn, cut=search.cut + 1), following)
        accepted &= ~kink
    following = _where(accepted, _no_search(jnp.zeros_like(h), 0 * search.goal), following)

    held = run._replace(totals=run.totals._replace(failure=jnp.where(sane, OK, hybrid.DIVERGED)))
    moved = _where(accepted, _moved(run, step, arrival, u, p, duration), held)
    return moved._replace(attempts=run.attempts + 1, search=jax.tree.map(stop_gradient, following))


def _arrival(run: _Interval, step: _Step, u: Any, p: Constants) -> _Arrival:
    """Where a step ends: on the event that is sought, by Newton's method from the step's end.

    So the event's time can be differentiated although the step's length is a constant.
    """
    search, end, goal = run.search, step.end, run.search.goal
    aims = jnp.abs(goal) == 1
    touch_miss = traced.touchdown_guard(goal, end.phi, p)
    late = jnp.where(aims, -touch_miss / stop_gradient(goal * end.dphi), 0.0)
    there = _extrapolated(step, late)
    before = there._replace(phi=jnp.where(aims, jnp.where(goal > 0, p.b, p.a), end.phi))
    landing = traced.after_touchdown(goal, there.theta, there.dphi, there.dtheta, u, p)
    landed = State(landing.phi, there.theta, landing.dphi, landing.dtheta)
    x0, z0 = traced.linear_momentum(*before, p)
    x1, z1 = traced.linear_momentum(*landed, p)
    after, mode = _where(aims, (landed, landing.mode), (end, run.mode))

    contact = _contact(end, step.acc_end, p)
    pull = traced.contact_guard(contact[0], 0.0)
    lift = traced.lift_off_guard(after.theta, after.dtheta, u, p)
    lift = jnp.where(mode == DOUBLE, lift, 0.0)
    miss = jnp.where(aims, touch_miss, jnp.where(goal == LIFT_OFF, lift, pull))
    rate = stop_gradient((miss - search.miss) / (step.h - search.before))  # the secant method's
    forced = (goal != NOTHING) & ~aims
    late = jnp.where(forced, -miss / rate, late)
    before, after = (_where(forced, _extrapolated(step, late), y) for y in (before, after))
    legal = jnp.broadcast_to(jnp.asarray(landing.legal), late.shape)
    demand = traced.friction_demand(x1 - x0, z1 - z0)
    return _Arrival(
        *(late, before, after, mode, landing.shift, legal, demand, contact, lift, pull, miss)
    )


def _narrowed(search: _Search, h: Any, arrival: _Arrival) -> _Search:
    """The search for an event after another attempt."""
    past = arrival.miss > 0
    low, high = jnp.where(past, search.low, h), jnp.where(past, h, search.high)
    length = h + arrival.late
    return search._replace(
        length=jnp.where((length > low) & (length < high), length, 0.5 * (low + high)),
        low=low,
        high=high,
        before=h,
        miss=arrival.miss,
        tries=search.tries + 1,
    )


def _moved(
    run: _Interval, step: _Step, arrival: _Arrival, u: Any, p: Constants, duration: float
) -> _Interval:
    """The interval after an accepted step, and after the event that ends it."""
    goal, totals = run.search.goal, run.totals
    aims = jnp.abs(goal) == 1
    down = aims & arrival.legal
    leaves = (goal == LIFT_OFF) | (down & (arrival.mode == DOUBLE) & (arrival.lift > 0))
    final = arrival.after
    phi, shift = traced.after_lift_off(final.theta, final.dtheta, u, p)
    final = final._replace(phi=jnp.where(leaves, phi, final.phi))
    mode = jnp.where(leaves, SINGLE, jnp.where(aims & ~down, run.mode, arrival.mode))
    acc = Accelerations(*traced.accelerations(mode, *final, u, p))
    contact = _contact(final, acc, p)
    pull = traced.contact_guard(contact[0], 0.0)
    left = run.left - (step.h + arrival.late)
    left = jnp.where(left <= 1e-4 * NUMERICS[str(left.dtype)].located, 0.0, left)
    events = run.events + down + leaves

    fastest = jnp.maximum(jnp.abs(final.dphi), jnp.abs(final.dtheta))
    failure = jnp.where(fastest > MAX_RATE, hybrid.RATE_EXCEEDED, OK)
    many = events > MAX_EVENTS * max(1.0, duration / CONTROL_PERIOD)
    failure = jnp.where(many, hybrid.TOO_MANY_EVENTS, failure)
    lost = ((down | leaves) & (pull > 0)) | (goal == RELEASE)
    failure = jnp.where(lost, CONTACT_LOST, failure)
    failure = jnp.where(aims & ~down, hybrid.THESIS_BACKWARD, failure)

    electrical, positive = _work(step, arrival.before, step.h + arrival.late, u, p)
    forces, demands, clearances = zip(arrival.contact, contact, strict=True)
    impulse = jnp.where(down, arrival.demand, 0.0)
    measured = totals._replace(
        electrical=totals.electrical + electrical,
        electrical_positive=totals.electrical_positive + positive,
        min_normal_force=functools.reduce(jnp.minimum, forces, totals.min_normal_force),
        friction_demand=functools.reduce(jnp.maximum, demands, totals.friction_demand),
        impulse_friction_demand=jnp.maximum(totals.impulse_friction_demand, impulse),
        clearance=functools.reduce(jnp.minimum, clearances, totals.clearance),
        touchdowns=totals.touchdowns + down,
        touchdown_time=jnp.where(down, duration - left, totals.touchdown_time),
        failure=failure,
    )
    foot = run.foot + jnp.where(down, arrival.shift, 0) + jnp.where(leaves, shift, 0)
    lift = jnp.where(leaves, 0.0, arrival.lift)
    return _Interval(
        *(final, acc, mode, foot, left, measured, lift, pull, events, run.attempts, run.search)
    )


def _nearer(step: _Step, p: Constants) -> Any:
    """The direction of the touchdown that is nearer."""
    return jnp.where(step.y.phi + step.end.phi > p.a + p.b, 1, -1)


def _touches(step: _Step, mode: Any, p: Constants) -> tuple[Any, Any, Any]:
    """Whether a step passes the nearer touchdown, a time (s) near it and one past it.

    That is where the quintic through the step's ends passes it, or would before it turns back.
    """
    past = traced.past_guard(_nearer(step, p), *step, p)
    turns = (past[1] > 0) & (traced.slope(past, 1.0) < 0)
    whole = jnp.ones_like(step.h)
    top = root(traced.negative(traced.derivative(past)), 0.0, whole)
    top = jnp.where(turns, top, whole)
    over = traced.value(past, top) > 0.1 * attempt.LOCATED
    return (mode == SINGLE) & over, traced.upward_root(past, top) * step.h, top * step.h


def _typed(p: Constants, like: Any) -> Constants:
    """Of two Python floats, JAX chooses one in the precision that it prefers: not of these."""
    return p._replace(a=jnp.full_like(like, p.a), b=jnp.full_like(like, p.b))


def _absent(coefficient: Any) -> bool:
    """Whether a loss is known to be absent."""
    return isinstance(coefficient, float) and coefficient == 0.0


def _where(test: Any, yes: Any, no: Any) -> Any:
    return jax.tree.map(functools.partial(jnp.where, test), yes, no)


def _extrapolated(step: _Step, time: Any) -> State:
    """The state a short time after a step."""
    y, acc = step.end, step.acc_end
    half = 0.5 * time * time
    return State(
        y.phi + time * y.dphi + half * acc.ddphi,
        y.theta + time * y.dtheta + half * acc.ddtheta,
        y.dphi + time * acc.ddphi,
        y.dtheta + time * acc.ddtheta,
    )


def _work(step: _Step, before: State, length: Any, u: Any, p: Constants) -> tuple[Any, Any]:
    """Electrical energy of a step until `before`, and its positive part (J).

    It is split where the current changes sign: there the power is 0, so that the place need not be
    differentiated.
    """
    y, end = step.y, step.end
    rate, rate_end = (traced.relative_rate(x.dphi, x.dtheta, p) for x in (y, end))
    bend, bend_end = (traced.relative_rate(*acc, p) for acc in (step.acc, step.acc_end))
    whole, turn = (traced.relative_rate(x.phi - y.phi, x.theta - y.theta, p) for x in (end, before))
    course = traced.quintic(0.0, rate, bend, whole, rate_end, bend_end, step.h)
    peak = traced._zero(traced.derivative(traced.derivative(course)), bend, bend_end)
    level = math.inf if _absent(p.K) else u / p.K
    turning = SimpleNamespace(turn=course, rate=rate, rate_end=rate_end, peak=peak)
    total = u * traced.motor_charge(turn, u, length, p)
    first, second = (
        jnp.where(s < 1, u * traced.motor_charge(traced.value(course, s), u, step.h * s, p), total)
        for s in map(stop_gradient, traced._crossings(turning, level, step.h))
    )
    pieces = first, second - first, total - second
    return total, sum(jnp.maximum(piece, 0.0) for piece in pieces)
