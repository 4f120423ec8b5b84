"""One attempt at a step in every lane of a tile: integrated, measured, and accepted or judged."""

from __future__ import annotations

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
    after_lift_off,
    after_touchdown,
    contact_guard,
    drag_pole,
    friction_pole,
    gear_torque,
    mass_matrix,
    psi_mobility,
    regularity,
    relative_rate,
)
from rimless_gym.jit import inlined, inner, vectorised
from rimless_gym.kernel import tile as of
from rimless_gym.kernel.booking import (
    accept,
    book_touchdown,
    close,
    forget_extremes,
    measure,
    restart,
)
from rimless_gym.kernel.events import LIFT_OFF, NOTHING, RELEASE, force_guard, judge
from rimless_gym.kernel.integration import find_sines, rk8
from rimless_gym.kernel.lanes import LANES, one_copy
from rimless_gym.kernel.tile import get_acc, get_state, machine
from rimless_gym.kernel.work import split_at_current, split_work

#: Steps are so short that pole * h and turning * h stay below these (see `plan`). Energy then
#: balances to a relative 1e-7 over an interval of any machine, and to 1e-11 on a gait. Angles turn
#: well below `trigonometry.MAX_TURN`, the limit of the stages' sines; `judge` enforces that limit.
MAX_POLE_STEP, MAX_RATE_STEP = 0.15, 0.16

#: In a step, psi' and the gear's torque change by no more than this share of their distance from
#: where dry friction bends most.
MAX_BEND_STEP = 0.35

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


@vectorised
def plan(tile):
    """Set the length of every lane's attempt: one under way, or the longest that accuracy allows.

    The time left is divided into equal steps, short enough for the poles of motor, friction and air
    drag and for the fastest rate in the equations. That is the rate of phi + theta, with what half
    of the time left adds to it; it counts for more where the accelerations' peak is narrower than
    1 rad. Lanes that are done get a length of 0. Returns how many lanes stand on two feet or move
    too fast.
    """
    unusual = 0
    for lane in range(LANES):
        p, acc = machine(tile, lane), get_acc(tile, of.ACC, lane)
        y = get_state(tile, of.STATE, lane)
        left, attempt = tile[of.LEFT + lane], tile[of.ATTEMPT + lane]
        rolling = abs(y.dphi) + 0.5 * left * abs(acc.ddphi)
        swinging = abs(y.dtheta) + 0.5 * left * abs(acc.ddtheta)
        rate = rolling + swinging
        turning = rate / min(max(peak(p), LEAST_PEAK), 1.0)
        braking = drag_pole(rolling, p)
        damping = (tile[of.POLE + lane] + braking) * (1 / MAX_POLE_STEP)
        rubbing = friction_rate(y, acc, min(rate, 2 * MAX_RATE), tile[of.VOLTAGE + lane], p)
        fastest = max(damping, turning * (1 / MAX_RATE_STEP), rubbing, 1e-9)
        h = attempt if attempt >= 0.0 else left / np.ceil(left * fastest)
        runs = left > 0.0 and tile[of.FAILURE + lane] == OK
        tile[of.STEP + lane] = h if runs else 0.0
        usual = tile[of.MODE + lane] == SINGLE and max(abs(y.dphi), abs(y.dtheta)) <= MAX_RATE
        unusual += 0 if usual else 1
    return unusual


@inner
def prepare(tile, lane, pull):
    """Before a new step of a lane on two feet: lift off if a foot would have to be pulled down."""
    if not runs(tile, lane) or tile[of.ATTEMPT + lane] >= 0.0:
        return
    y, u, p = get_state(tile, of.STATE, lane), tile[of.VOLTAGE + lane], machine(tile, lane)
    if too_fast(tile, lane) or tile[of.MODE + lane] == SINGLE:
        return
    if force_guard(LIFT_OFF, float(DOUBLE), y, u, pull, p) > 0.0:
        if tile[of.EVENTS + lane] == 0.0:  # at this voltage it never stood on two feet
            forget_extremes(tile, lane)
        lift_off(tile, lane, pull)


@inner
def too_fast(tile, lane):
    """End a lane's motion if it is too fast for the model; returns whether it did."""
    y = get_state(tile, of.STATE, lane)
    fastest = max(abs(y.dphi), abs(y.dtheta))
    if tile[of.FAILURE + lane] != OK or fastest <= MAX_RATE:
        return False
    tile[of.FAILURE + lane] = RATE_EXCEEDED if fastest > MAX_RATE else DIVERGED
    return True


@inner
def lift_off(tile, lane, pull):
    """From two feet to one, or to none."""
    y, u, p = get_state(tile, of.STATE, lane), tile[of.VOLTAGE + lane], machine(tile, lane)
    phi, shift = after_lift_off(y.theta, y.dtheta, u, p)
    after = State(phi, y.theta, 0.0, y.dtheta)
    fy = restart(tile, lane, float(SINGLE), tile[of.FOOT + lane] + shift, after, pull)
    if contact_guard(fy, pull) > 0.0:
        tile[of.FAILURE + lane] = CONTACT_LOST


@inner
def arrive(tile, lane, event, duration, pull):
    """Apply the event at the end of an accepted step."""
    if event == RELEASE:
        tile[of.FAILURE + lane] = CONTACT_LOST
        return
    if event == LIFT_OFF:
        lift_off(tile, lane, pull)
    else:
        y, u, p = get_state(tile, of.STATE, lane), tile[of.VOLTAGE + lane], machine(tile, lane)
        landing = after_touchdown(event, y.theta, y.dphi, y.dtheta, u, p)
        if not landing.legal:
            tile[of.FAILURE + lane] = THESIS_BACKWARD
            return
        after = State(landing.phi, y.theta, landing.dphi, landing.dtheta)
        book_touchdown(tile, lane, y, after, landing.shift, duration - tile[of.LEFT + lane])
        foot = tile[of.FOOT + lane] + landing.shift
        fy = restart(tile, lane, float(landing.mode), foot, after, pull)
        if contact_guard(fy, pull) > 0.0:
            tile[of.FAILURE + lane] = CONTACT_LOST
    if tile[of.EVENTS + lane] > MAX_EVENTS * max(1.0, duration / CONTROL_PERIOD):
        tile[of.FAILURE + lane] = TOO_MANY_EVENTS


@inner
def runs(tile, lane):
    """Whether a lane still has time left and has not failed."""
    return tile[of.LEFT + lane] > 0.0 and tile[of.FAILURE + lane] == OK


@inner
def attempt_step(tile, count, duration, pull):
    """One attempt at a step in the first `count` lanes; returns how many of them need another."""
    one_copy()
    for lane in range(count, LANES):
        tile[of.LEFT + lane] = 0.0
    if plan(tile):
        for lane in range(count):
            prepare(tile, lane, pull)
        plan(tile)
    rk8(tile)
    current, split, flagged = measure(tile, pull)
    if current:
        split_at_current(tile)
    if flagged:
        for lane in range(count):
            if tile[of.FLAG + lane] == of.FLAGGED and judge(tile, lane, pull):
                tile[of.FLAG + lane] = of.SPLIT
    if split or flagged:
        split_work(tile)
    unfinished = accept(tile, duration)
    if not flagged:
        return unfinished
    unfinished = 0
    for lane in range(count):
        event = int(tile[of.EVENT + lane])
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
