"""Floquet multipliers against what is known of a passive wheel.

A wheel without motor or pendulum that walks down a slope has one cycle. A step multiplies the
square of its rate by eta^2 (tests/rimless_gym/test_passive_cycles.py), which is the multiplier of
the cycle's speed; a shift in time, and the idle pendulum's angle and rate, are neutral.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rimless_gym import WheelParams, simulate
from trajopt import Extremal, Mesh, Problem, solve
from trajopt.gaits.problem import WheelPhases
from trajopt.gaits.stability import floquet_multipliers, monodromy
from trajopt.ocp.solving.guesses import polyline


def passive(n_legs: int, slope: float, inertia: float) -> WheelParams:
    return WheelParams(
        n_legs=n_legs,
        slope=slope,
        wheel_inertia=inertia,
        pendulum_length=0.0,
        pendulum_inertia=0.1,
        motor_constant=0.0,
    )


def cycle(params: WheelParams) -> Extremal:
    wheel, c = WheelPhases(params), params.constants
    step = wheel.single_stance()
    hanging = step.start | {"theta": 0.0, "theta'": 0.0}
    step = dataclasses.replace(step, start=hanging, duration=(0.05, 5.0))
    t = np.linspace(0.0, 0.4, 9)
    phi = c.a + c.alpha * t / t[-1]
    guess = polyline(t, np.stack([phi, 0 * t, np.gradient(phi, t), 0 * t], axis=1))
    problem = Problem((step,), (wheel.touchdown(0, 0),))
    return solve(problem, [guess], Mesh.uniform(1, 6, 6))


CASES = [(6, 0.2, 0.0), (8, 0.12, 0.05), (10, 0.06, 0.2)]


@pytest.mark.parametrize(("n_legs", "slope", "inertia"), CASES)
def test_the_multiplier_of_a_passive_cycle_is_eta_squared(
    n_legs: int, slope: float, inertia: float
) -> None:
    params = passive(n_legs, slope, inertia)
    ml2 = params.total_mass * params.leg_length**2
    eta = (inertia + ml2 * math.cos(params.leg_angle)) / (inertia + ml2)
    found = cycle(params)
    assert found.converged, found.report()
    multipliers = np.sort(np.abs(floquet_multipliers(params, found.phases)))
    assert multipliers[0] == pytest.approx(eta**2, rel=1e-6)
    assert multipliers[1:] == pytest.approx(np.ones(3), abs=1e-5)


def test_finite_differences_of_the_reference_simulation_agree() -> None:
    params = passive(8, 0.12, 0.05)
    found = cycle(params)
    T, start = found.duration, found.phases[0].start

    def after_a_stride_and_a_bit(change: float) -> np.ndarray:
        x = start + np.array([0.0, 0.0, change, 0.0])
        return np.asarray(simulate(params, x, lambda t, x: 0.0, T + 0.02).x[-1])

    size = 1e-5
    moved = after_a_stride_and_a_bit(size) - after_a_stride_and_a_bit(-size)
    column = monodromy(params, found.phases)[:, 2] * 1e-3
    onwards = start + np.array([1e-3, 0.0, 0.0, 0.0])  # off the guard, on both sides

    def later(x: np.ndarray) -> np.ndarray:
        return np.asarray(simulate(params, x, lambda t, x: 0.0, 0.02).x[-1])

    predicted = (later(onwards + column) - later(onwards - column)) / 2e-3
    assert moved / (2 * size) == pytest.approx(predicted, rel=2e-3, abs=2e-4)
