"""Events against a simulation without modes: time stepping with complementary contacts.

This is Moreau's scheme on MuJoCo's floating machine. In each step every foot at or below the ground
either pushes and sticks, or rises. Complementarity of impulses and velocities decides which, so
touchdown, standing on two feet and lift-off follow without `rimless_gym.hybrid`. The scheme is of
first order in its step.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL, Trajectory, WheelParams, hybrid, simulate
from rimless_gym.export import joint_state

STEPS = (8e-4, 2e-4)  # s


@dataclasses.dataclass
class Motion:
    """Joint positions and rates (N, 4) at times (N,), and how many feet pushed in that step."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    feet: np.ndarray

    @property
    def rest_since(self) -> float:
        """The time from which it stands on two feet until the end."""
        return float(self.t[np.flatnonzero(self.feet < 2)[-1]])

    @property
    def lift_off(self) -> float:
        """When it first had fewer than two feet on the ground."""
        return float(self.t[np.flatnonzero(self.feet < 2)[0] - 1])


def time_stepping(
    wheel, q: np.ndarray, v: np.ndarray, volts: Callable[[float], float], duration: float, h: float
) -> Motion:
    """The motion of a `FreeWheel` from joint positions and rates, in steps of h."""
    samples, v_before = [(0.0, q, v, 2)], v
    for k in range(round(duration / h)):
        middle = q + h / 2 * v
        smooth = len(samples) > 1 and samples[-1][3] == samples[-2][3]
        wheel.move(middle, v + (v - v_before) / 2 * smooth, volts((k + 0.5) * h))
        touching = np.flatnonzero(wheel.data.site_xpos[:, 2] <= 1e-10)
        jacobians = [wheel.jacobian(foot) for foot in touching]
        v_before = v
        v, feet = after_contact(wheel.inertia(), v, h * wheel.force(), jacobians)
        q = middle + h / 2 * v
        samples.append(((k + 1) * h, q, v, feet))
    return Motion(*(np.array(column) for column in zip(*samples, strict=True)))


def after_contact(
    inertia: np.ndarray, v: np.ndarray, impulse: np.ndarray, jacobians: list[np.ndarray]
) -> tuple[np.ndarray, int]:
    """Rates after a step, and how many of the feet with these Jacobians push.

    A second foot is not held horizontally: on a rigid wheel the first one does that.
    """
    inverse = np.linalg.inv(inertia)
    free = v + inverse @ impulse
    for count in range(len(jacobians) + 1):
        for chosen in itertools.combinations(jacobians, count):
            after, pushes = free, np.zeros(0)
            if chosen:
                jacobian = np.concatenate([chosen[0], *(foot[1:] for foot in chosen[1:])])
                spread = inverse @ jacobian.T
                pushes = np.linalg.solve(jacobian @ spread, -jacobian @ free)
                after = free + spread @ pushes
            rising = [foot[1] @ after for foot in jacobians if not any(foot is c for c in chosen)]
            if all(push >= 0 for push in pushes[1:]) and all(rate >= 0 for rate in rising):
                return after, count
    raise AssertionError("no set of feet fits")


def apart(ours: Trajectory, theirs: Motion) -> float:
    """The largest distance between two motions' joint positions (m and rad), at any time."""
    t = theirs.t[theirs.t <= ours.t[-1]]
    feet = ours.foot[np.searchsorted(ours.t, t, side="right") - 1]
    states = ours.state(t)
    q = np.array(
        [joint_state(ours.params, x, int(k))[0] for x, k in zip(states, feet, strict=True)]
    )
    return float(np.abs(q - theirs.q[: len(t)]).max())


def converging(
    free_wheel,
    params: WheelParams,
    x: list[float],
    volts: Callable[[float], float],
    duration: float,
    mode: str = "single_stance",
) -> tuple[Trajectory, list[Motion]]:
    """Our motion, and the other at smaller and smaller steps h; their distance is of order h."""
    ours = simulate(params, x, lambda t, _: volts(t), duration, mode=mode, pull=0.0)
    assert ours.failure is None
    q, v = joint_state(params, x)
    theirs = [time_stepping(free_wheel(params), q, v, volts, duration, h) for h in STEPS]
    misses = [apart(ours, motion) for motion in theirs]
    assert np.all(np.divide(misses, STEPS) < 15)
    return ours, theirs


@pytest.mark.parametrize(("n_legs", "direction"), [(3, 1), (5, -1)])
def test_a_wheel_that_falls_slowly_comes_to_rest_on_two_feet(free_wheel, n_legs, direction):
    params = THESIS_PHYSICAL.replace(n_legs=n_legs, slope=0.03, hub_damping=0.1)
    x = [math.pi / 2 + direction * 0.6 * params.leg_angle / 2, 0.4, direction * 0.2, 1.0]
    ours, theirs = converging(free_wheel, params, x, lambda t: 0.0, 0.8)
    assert ours.final_mode == "double_stance"
    entry = next(event.time for event in ours.events if event.mode == "double_stance")
    for h, motion in zip(STEPS, theirs, strict=True):  # hops of order h are not resolved
        assert motion.rest_since == pytest.approx(entry, abs=0.7 * math.sqrt(h))


@pytest.mark.parametrize(("mount", "spin", "direction"), [("wheel", 0.0, -1), ("frame", 4.0, 1)])
def test_a_wheel_at_rest_lifts_off_when_the_voltage_has_grown_enough(
    free_wheel, mount, spin, direction
):
    params = THESIS_PHYSICAL.replace(
        motor_mount=mount, slope=0.05, rotor_inertia=1e-7, voltage_limit=100.0
    )
    x = [params.constants.a, 0.3 * direction, 0.0, spin * direction]
    ours, theirs = converging(
        free_wheel, params, x, lambda t: direction * 100 * t, 0.5, "double_stance"
    )
    (event,) = ours.events
    assert (event.kind, event.direction) == ("lift_off", direction)
    for h, motion in zip(STEPS, theirs, strict=True):
        assert motion.lift_off == pytest.approx(event.time, abs=h)


@pytest.mark.parametrize("seed", [1, 5])
def test_steps_forward_and_back_agree_with_the_contact_simulation(free_wheel, seed):
    params = THESIS_PHYSICAL.replace(slope=0.05, rotor_inertia=1e-7)
    p, rng = params.constants, np.random.default_rng(seed)
    x = rng.uniform([p.a, -3, -1, -4], [p.b, 3, 2, 4])
    ours, _ = converging(free_wheel, params, x, lambda t: 6 * math.sin(9 * t + seed), 0.8)
    assert ours.touchdowns


def test_friction_is_needed_in_either_direction_and_none_suffices_without_pressure() -> None:
    assert hybrid.friction_demand(-3.0, 4.0) == hybrid.friction_demand(3.0, 4.0) == 0.75
    assert hybrid.friction_demand(1.0, -1.0) == math.inf
