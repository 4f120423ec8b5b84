"""One attempt at a step in every lane of a tile: integrated, measured, accepted or corrected."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rimless_gym.equations import DOUBLE, SINGLE, State
from rimless_gym.hybrid import (
    CONTACT_LOST,
    CONTROL_PERIOD,
    DIVERGED,
    MAX_EVENTS,
    MAX_RATE,
    OK,
    RATE_EXCEEDED,
    THESIS_BACKWARD,
    TOO_MANY_EVENTS,
    accelerations,
    after_lift_off,
    after_touchdown,
    contact_guard,
    crosses_kink,
    drag_pole,
    friction_pole,
    gear_torque,
    ground_reaction,
    lift_off_guard,
    mass_matrix,
    psi_mobility,
    regularity,
    relative_rate,
    swing_frequency,
    touchdown_guard,
)
from rimless_gym.jit import inlined, inner, vectorised
from rimless_gym.kernel import tile as slot
from rimless_gym.kernel.accounting import (
    accept,
    add_touchdown,
    close,
    forget_extremes,
    measure,
    restart,
    split_at_current,
    split_work,
)
from rimless_gym.kernel.integration import (
    derivative,
    find_sines,
    negative,
    quintic,
    rk8,
    slope,
    upward_root,
    value,
)
from rimless_gym.kernel.tile import LANES, constants, get_acc, get_state, one_copy, put_state
from rimless_gym.trigonometry import MAX_TURN

#: Steps are so short that pole * h and turning * h stay below these (see `plan`). Energy then
#: balances to a relative 1e-7 over an interval of any machine, and to 1e-11 on a gait. Angles turn
#: well below `trigonometry.MAX_TURN`, the limit of the stages' sines (`check_attempt`).
MAX_POLE_STEP, MAX_RATE_STEP = 0.15, 0.16

#: In a step, psi' and the gear's torque change by no more than this share of their distance from
#: where dry friction bends most.
MAX_BEND_STEP = 0.35

LOCATED = 1e-13  # rad: how near to its guard a located touchdown is
GRAZE = 1e-6  # rad: where a leg reverses this near to its guard, a step ends

#: What a step may end on; the first two are also the directions of a touchdown.
FORWARD, BACKWARD, NOTHING, LIFT_OFF, RELEASE = (np.int64(k) for k in (1, -1, 0, 2, 3))

_AT_REVERSAL, _AT_TURN = 1, 2  # what may have cut a step
_HERE = 1e-6  # fraction of a step: a cut this near to its start has been made already

#: Narrowest peak of the accelerations (rad) that steps resolve; below it, balances get worse.
LEAST_PEAK = 0.01


@inlined
def peak(p):
    """Width (rad) of the accelerations' peak in the pose whose mass matrix is nearest to singular.

    It is narrow for light wheels with heavy pendulums, where the rod is in line with the leg.
    """
    m11, m12, m22 = mass_matrix(0.0, 0.5 * np.pi, p)
    return np.sqrt(regularity(0.5 * np.pi, p) * m11 * m22 / (p.Je3 * m12))


@inlined
def friction_rate(y, acc, rate, u, p):
    """How fast (1/s) dry friction makes the motion change: 0 without it.

    Steps must resolve three things: how fast friction damps psi'; its change of direction, where
    |psi'| is about w; and the bend in its level, where the gear's torque is about F0 / c. `rate` is
    the fastest rate of the angles (rad/s).
    """
    dpsi, ddpsi = relative_rate(y.dphi, y.dtheta, p), relative_rate(acc.ddphi, acc.ddtheta, p)
    torque = gear_torque(dpsi, ddpsi, u, p)
    gearing = p.Jr * psi_mobility(0.0, p)  # share of a torque at the hub that turns the rotor
    swing = p.S2 * (p.gy + abs(p.gx)) + p.Je3 * rate * rate  # gravity's and centrifugal torque
    change = (1 - gearing) * p.K * p.K * p.G * abs(ddpsi) + gearing * swing * rate
    level = np.sqrt((p.c * torque) ** 2 + p.F0 * p.F0)
    exists = 1.0 if p.F0 > 0.0 else 0.0
    reversing = exists * abs(ddpsi) / np.sqrt(dpsi * dpsi + p.w * p.w)
    loading = p.c * change / max(level, 1e-300)
    fed_back = p.c * gearing  # friction changes psi'', and so the torque that causes it
    braking = friction_pole(dpsi, torque, p) * (1 / MAX_POLE_STEP)
    steepest = max(braking, reversing * (1 / MAX_BEND_STEP)) / (1 - fed_back * fed_back)
    return max(steepest, loading * (1 / MAX_BEND_STEP))


@inlined
def windage_rate(y, acc, p):
    """How fast (1/s) theta' crosses the width w in which the air's torque bends: 0 without it."""
    exists = 1.0 if p.Cp > 0.0 else 0.0
    reversing = exists * abs(acc.ddtheta) / np.sqrt(y.dtheta * y.dtheta + p.w * p.w)
    return reversing * (1 / MAX_BEND_STEP)


@vectorised
def plan(tile):
    """Set the length of every lane's attempt: one under way, or the longest that accuracy allows.

    The time left is divided into equal steps, short enough for the poles of motor, friction and air
    drag, for where these bend, and for the fastest rate in the equations. That is the rate of
    phi + theta, with what half of the time left adds to it; it counts for more where the
    accelerations' peak is narrower than 1 rad, and for no less than the frequency at which gravity
    swings the pendulum. No step is longer than 10 ms: psi' may come to a stop by dry friction while
    psi'' was small where the step began. Lanes that are done get a length of 0. Returns how many
    lanes stand on two feet, and how many move too fast.
    """
    standing = fast = 0
    for lane in range(LANES):
        p, acc = constants(tile, lane), get_acc(tile, slot.ACC, lane)
        y = get_state(tile, slot.STATE, lane)
        left, attempt = tile[slot.LEFT + lane], tile[slot.ATTEMPT + lane]
        rolling = abs(y.dphi) + 0.5 * left * abs(acc.ddphi)
        swinging = abs(y.dtheta) + 0.5 * left * abs(acc.ddtheta)
        rate = rolling + swinging
        turning = max(rate / min(max(peak(p), LEAST_PEAK), 1.0), swing_frequency(p))
        braking = drag_pole(rolling, swinging, p)
        damping = (tile[slot.POLE + lane] + braking) * (1 / MAX_POLE_STEP)
        rubbing = friction_rate(y, acc, min(rate, 2 * MAX_RATE), tile[slot.VOLTAGE + lane], p)
        bending = max(rubbing, windage_rate(y, acc, p))
        fastest = max(damping, turning * (1 / MAX_RATE_STEP), bending, 1 / CONTROL_PERIOD)
        h = attempt if attempt >= 0.0 else left / np.ceil(left * fastest)
        runs = left > 0.0 and tile[slot.FAILURE + lane] == OK
        tile[slot.STEP + lane] = h if runs else 0.0
        slow = max(abs(y.dphi), abs(y.dtheta)) <= MAX_RATE
        standing += 1 if runs and tile[slot.MODE + lane] == DOUBLE else 0
        fast += 1 if runs and not slow else 0
    return standing, fast


def _feet(quantity: np.int64) -> Callable[..., int]:
    @vectorised
    def pull_feet(tile):
        """Set FOOT_PULL to the lift-off guard in a state; returns in how many lanes it is passed.

        Only lanes that make an attempt on two feet count.
        """
        lifting = 0
        for lane in range(LANES):
            y, p = get_state(tile, quantity, lane), constants(tile, lane)
            guard = lift_off_guard(y.theta, y.dtheta, tile[slot.VOLTAGE + lane], p)
            tile[slot.FOOT_PULL + lane] = guard
            stands = tile[slot.MODE + lane] == DOUBLE and tile[slot.STEP + lane] > 0.0
            lifting += 1 if stands and guard > 0.0 else 0
        return lifting

    pull_feet.__qualname__ = f"pull_feet_{quantity}"
    return pull_feet


pull_feet_at_start, pull_feet_at_end = _feet(slot.STATE), _feet(slot.NEXT)


@inner
def prepare(tile, lane, pull):
    """Before a new step of a lane on two feet: lift off if a foot would have to be pulled down."""
    if not runs(tile, lane) or tile[slot.ATTEMPT + lane] >= 0.0:
        return
    if too_fast(tile, lane) or tile[slot.MODE + lane] == SINGLE:
        return
    if tile[slot.FOOT_PULL + lane] > 0.0:
        if tile[slot.EVENTS + lane] == 0.0:  # at this voltage it never stood on two feet
            forget_extremes(tile, lane)
        lift_off(tile, lane, pull)


@inner
def too_fast(tile, lane):
    """End a lane's motion if it is too fast for the model; returns whether it did."""
    y = get_state(tile, slot.STATE, lane)
    fastest = max(abs(y.dphi), abs(y.dtheta))
    if tile[slot.FAILURE + lane] != OK or fastest <= MAX_RATE:
        return False
    tile[slot.FAILURE + lane] = RATE_EXCEEDED if fastest > MAX_RATE else DIVERGED
    return True


@inner
def lift_off(tile, lane, pull):
    """From two feet to one, or to none."""
    y, u, p = get_state(tile, slot.STATE, lane), tile[slot.VOLTAGE + lane], constants(tile, lane)
    phi, shift = after_lift_off(y.theta, y.dtheta, u, p)
    after = State(phi, y.theta, 0.0, y.dtheta)
    fy = restart(tile, lane, float(SINGLE), tile[slot.FOOT + lane] + shift, after, pull)
    if contact_guard(fy, pull) > 0.0:
        tile[slot.FAILURE + lane] = CONTACT_LOST


@inner
def arrive(tile, lane, event, duration, pull):
    """Apply the event at the end of an accepted step."""
    if event == RELEASE:
        tile[slot.FAILURE + lane] = CONTACT_LOST
        return
    if event == LIFT_OFF:
        lift_off(tile, lane, pull)
    else:
        between_feet = slot.AHEAD if event == FORWARD else slot.BEHIND
        tile[slot.BEHIND + lane] = tile[slot.AHEAD + lane] = tile[between_feet + lane]
        y, u, p = (
            get_state(tile, slot.STATE, lane),
            tile[slot.VOLTAGE + lane],
            constants(tile, lane),
        )
        landing = after_touchdown(event, y.theta, y.dphi, y.dtheta, u, p)
        if not landing.legal:
            tile[slot.FAILURE + lane] = THESIS_BACKWARD
            return
        after = State(landing.phi, y.theta, landing.dphi, landing.dtheta)
        add_touchdown(tile, lane, y, after, landing.shift, duration - tile[slot.LEFT + lane])
        foot = tile[slot.FOOT + lane] + landing.shift
        fy = restart(tile, lane, float(landing.mode), foot, after, pull)
        if contact_guard(fy, pull) > 0.0:
            tile[slot.FAILURE + lane] = CONTACT_LOST
    if tile[slot.EVENTS + lane] > MAX_EVENTS * max(1.0, duration / CONTROL_PERIOD):
        tile[slot.FAILURE + lane] = TOO_MANY_EVENTS


@inner
def runs(tile, lane):
    """Whether a lane still has time left and has not failed."""
    return tile[slot.LEFT + lane] > 0.0 and tile[slot.FAILURE + lane] == OK


@inner
def attempt_step(tile, count, duration, pull):
    """One attempt at a step in the first `count` lanes; returns how many of them need another."""
    one_copy()
    for lane in range(count, LANES):
        tile[slot.LEFT + lane] = 0.0
    standing, fast = plan(tile)
    lifting = pull_feet_at_start(tile) if standing else 0
    if fast or lifting:
        for lane in range(count):
            prepare(tile, lane, pull)
        standing, _ = plan(tile)
    rk8(tile)
    if standing:
        pull_feet_at_end(tile)
    current, split, flagged = measure(tile, pull)
    if current:
        split_at_current(tile)
    if flagged:
        for lane in range(count):
            if tile[slot.FLAG + lane] == slot.FLAGGED and check_attempt(tile, lane, pull):
                tile[slot.FLAG + lane] = slot.SPLIT
    if split or flagged:
        split_work(tile)
    unfinished = accept(tile, duration)
    if not flagged:
        return unfinished
    unfinished = 0
    for lane in range(count):
        event = int(tile[slot.EVENT + lane])
        if event != NOTHING:
            arrive(tile, lane, event, duration, pull)
        if too_fast(tile, lane) or event != NOTHING:
            close(tile, lane, duration)
        unfinished += 1 if runs(tile, lane) else 0
    return unfinished


@inner
def attempt_again(tile, count, duration, pull):
    """`attempt_step` for lanes that have moved since their interval was opened."""
    one_copy()
    find_sines(tile)
    return attempt_step(tile, count, duration, pull)


# -- Location of events within a step --------------------------------------------------------------
#
# A touchdown is first located on the quintic through the step's ends. The step is then shortened to
# end there, and corrected until the leg is on its guard. Lift-off and loss of contact are located
# in the same way, on the forces. Every correction is another attempt at the same step.


@inner
def past_guard(direction, y0, acc0, y1, acc1, h, p):
    """Quintic of how far the leg is past a guard (rad) over a step."""
    return quintic(
        touchdown_guard(direction, y0.phi, p),
        direction * y0.dphi,
        direction * acc0.ddphi,
        touchdown_guard(direction, y1.phi, p),
        direction * y1.dphi,
        direction * acc1.ddphi,
        h,
    )


@inner
def turning_cut(y0, acc0, y1, acc1, h, p):
    """Fraction at which to cut a step, so that near a guard the leg reverses only at steps' ends.

    It is 1 where the leg is far from its guards. A turning point within `GRAZE` of a guard becomes
    the end of a step, where the state is exact. So does an inflection, because it separates two
    turning points.
    """
    for direction in (FORWARD, BACKWARD):
        c = past_guard(direction, y0, acc0, y1, acc1, h, p)
        if max(c[0], value(c, 1.0)) + 0.5 * h * max(abs(y0.dphi), abs(y1.dphi)) < 0.0:
            continue
        if acc0.ddphi * acc1.ddphi < 0.0:
            bend = derivative(derivative(c))
            s = upward_root(bend if bend[0] < 0.0 else negative(bend), 1.0)
            if 1e-3 < s < 0.999:
                return s
        if c[1] > 0.0 and slope(c, 1.0) < 0.0:
            s = upward_root(negative(derivative(c)), 1.0)
            if abs(value(c, s)) < GRAZE and _HERE < s < 0.9999:
                return s
    return 1.0


@inner
def touchdown_crossing(y0, acc0, y1, acc1, h, p):
    """First touchdown within a single-stance step: (direction or NOTHING, s near it, s past it)."""
    event, s_event, s_past = NOTHING, 2.0, 1.0
    for direction in (FORWARD, BACKWARD):
        c = past_guard(direction, y0, acc0, y1, acc1, h, p)
        s_end = 1.0
        if c[1] > 0.0 and slope(c, 1.0) < 0.0:  # it turns back inside the step: look at the top
            s_end = upward_root(negative(derivative(c)), 1.0)
        if value(c, s_end) > 0.1 * LOCATED:
            s = upward_root(c, s_end)
            if s < s_event:
                event, s_event, s_past = direction, s, s_end
    return event, s_event, s_past


@inner
def reversal(y0, acc0, y1, acc1, h):
    """Fraction of a step at which phi' changes sign, given that it does."""
    rate = derivative(quintic(y0.phi, y0.dphi, acc0.ddphi, y1.phi, y1.dphi, acc1.ddphi, h))
    return upward_root(rate if y1.dphi > 0.0 else negative(rate), 1.0)


@inner
def between(y0, acc0, y1, acc1, h, s):
    """State at fraction s of a step, from the quintics through its ends."""
    c = quintic(y0.phi, y0.dphi, acc0.ddphi, y1.phi, y1.dphi, acc1.ddphi, h)
    e = quintic(y0.theta, y0.dtheta, acc0.ddtheta, y1.theta, y1.dtheta, acc1.ddtheta, h)
    return State(value(c, s), value(e, s), slope(c, s) / h, slope(e, s) / h)


@inner
def force_guard(kind, mode, y, u, pull, p):
    """Positive once a foot would have to be pulled down.

    `LIFT_OFF`: one of two standing feet, in units of phi''. `RELEASE`: the feet together, in N
    beyond the largest `pull` that the ground can exert.
    """
    if kind == LIFT_OFF:
        return lift_off_guard(y.theta, y.dtheta, u, p)
    a = accelerations(mode, y.phi, y.theta, y.dphi, y.dtheta, u, p)
    fy = ground_reaction(y.phi, y.theta, y.dphi, y.dtheta, a.ddphi, a.ddtheta, p)[1]
    return contact_guard(fy, pull)


@inner
def check_attempt(tile, lane, pull):
    """Whether the attempt at a step stands; if not, this sets up the next one, or the failure."""
    y, acc = get_state(tile, slot.STATE, lane), get_acc(tile, slot.ACC, lane)
    end, acc_end = get_state(tile, slot.NEXT, lane), get_acc(tile, slot.NEXT_ACC, lane)
    mode, u, h = tile[slot.MODE + lane], tile[slot.VOLTAGE + lane], tile[slot.STEP + lane]
    goal, cut, p = int(tile[slot.GOAL + lane]), int(tile[slot.CUT + lane]), constants(tile, lane)
    if not max(abs(end.dphi), abs(end.dtheta)) < 10 * MAX_RATE:
        tile[slot.FAILURE + lane] = DIVERGED  # so fast, or NaN, that the step cannot be trusted
        return False
    if goal == NOTHING:
        if tile[slot.FAR + lane] > MAX_TURN * MAX_TURN:  # its sines are not accurate that far
            tile[slot.ATTEMPT + lane] = 0.5 * h
            return False
        if crosses_kink(y.dphi, end.dphi, p) and not cut:  # air drag has a kink: end there
            tile[slot.CUT + lane] = _AT_REVERSAL
            s = reversal(y, acc, end, acc_end, h)
            if s > _HERE:
                tile[slot.ATTEMPT + lane] = s * h
                return False
        if mode == SINGLE:
            if cut < _AT_TURN:
                s = turning_cut(y, acc, end, acc_end, h, p)
                if s < 1.0:
                    tile[slot.CUT + lane] = _AT_TURN
                    tile[slot.ATTEMPT + lane] = s * h
                    return False
            event, s, s_past = touchdown_crossing(y, acc, end, acc_end, h, p)
            if event != NOTHING:
                tile[slot.GOAL + lane] = event
                tile[slot.HIGH + lane] = s_past * h
                tile[slot.ATTEMPT + lane] = s * h
                return False
        elif tile[slot.FOOT_PULL + lane] > 0.0:
            _aim_at_force(tile, lane, LIFT_OFF, end, h, pull)
            return False
    elif not (_lands(tile, lane, goal, h) if abs(goal) == 1 else _lets_go(tile, lane, goal, pull)):
        return False
    if goal != RELEASE and h > 0.0:
        end = get_state(tile, slot.NEXT, lane)
        for s in (0.5, 1.0):
            there = between(y, acc, end, acc_end, h, s) if s < 1.0 else end
            if force_guard(RELEASE, mode, there, u, pull, p) > 0.0:
                _aim_at_force(tile, lane, RELEASE, there, s * h, pull)
                return False
    return True


@inner
def _lands(tile, lane, direction, tau):
    """Whether an attempt of length tau ends on the guard; if not, this sets up the next one.

    That is a step of Newton's method along phi', or of bisection if Newton leaves the bracket.
    """
    p = constants(tile, lane)
    end = get_state(tile, slot.NEXT, lane)
    low, high, tries = tile[slot.LOW + lane], tile[slot.HIGH + lane], tile[slot.TRIES + lane]
    miss = touchdown_guard(direction, end.phi, p)
    if abs(miss) <= LOCATED or high - low <= 1e-16 or tries >= 60:
        bound = p.b if direction > 0 else p.a
        put_state(tile, slot.NEXT, lane, (bound, end.theta, end.dphi, end.dtheta))
        return True
    if miss > 0.0:
        high = tau
    else:
        low = tau
    newton = tau - miss / (direction * end.dphi)
    tile[slot.ATTEMPT + lane] = newton if low < newton < high else 0.5 * (low + high)
    tile[slot.LOW + lane] = low
    tile[slot.HIGH + lane] = high
    tile[slot.TRIES + lane] = tries + 1
    return False


@inner
def _aim_at_force(tile, lane, kind, end, h, pull):
    """Aim at the time when a force guard turns positive; at `end`, after a time h, it is positive.

    Bisection on the quintics gives the first attempt.
    """
    y, acc = get_state(tile, slot.STATE, lane), get_acc(tile, slot.ACC, lane)
    mode, u, p = tile[slot.MODE + lane], tile[slot.VOLTAGE + lane], constants(tile, lane)
    acc_end = accelerations(mode, end.phi, end.theta, end.dphi, end.dtheta, u, p)
    low, high = 0.0, 1.0
    while high - low > 1e-15:
        middle = 0.5 * (low + high)
        if force_guard(kind, mode, between(y, acc, end, acc_end, h, middle), u, pull, p) > 0.0:
            high = middle
        else:
            low = middle
    tile[slot.GOAL + lane] = kind
    tile[slot.ATTEMPT + lane] = high * h
    tile[slot.HIGH + lane] = h
    tile[slot.BEFORE + lane] = h
    tile[slot.MISS_BEFORE + lane] = force_guard(kind, mode, end, u, pull, p)
    tile[slot.TRIES + lane] = 0.0


@inner
def _lets_go(tile, lane, kind, pull):
    """Whether an attempt ends where a force guard turns positive; if not, this sets up the next.

    There are at most two, both steps of the secant method.
    """
    end, tau = get_state(tile, slot.NEXT, lane), tile[slot.STEP + lane]
    mode, u, p = tile[slot.MODE + lane], tile[slot.VOLTAGE + lane], constants(tile, lane)
    miss, tries = force_guard(kind, mode, end, u, pull, p), tile[slot.TRIES + lane]
    before, miss_before = tile[slot.BEFORE + lane], tile[slot.MISS_BEFORE + lane]
    if tries >= 2 or miss in (0.0, miss_before):
        return True
    corrected = tau - miss * (tau - before) / (miss - miss_before)
    tile[slot.ATTEMPT + lane] = min(max(corrected, 0.0), tile[slot.HIGH + lane])
    tile[slot.BEFORE + lane] = tau
    tile[slot.MISS_BEFORE + lane] = miss
    tile[slot.TRIES + lane] = tries + 1
    return False
