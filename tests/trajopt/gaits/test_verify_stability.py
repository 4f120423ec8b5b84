"""Floquet multipliers against what is known of a passive wheel, and against simulations.

A wheel without motor or pendulum that walks down a slope has one cycle. A step multiplies the
square of its rate by eta^2 (tests/rimless_gym/test_reference.py), which is the multiplier of
the cycle's speed; a shift in time, and the idle pendulum's angle and rate, are neutral.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from rimless_gym import THESIS_PHYSICAL, WheelParams, simulate
from trajopt import Extremal, Mesh, Problem, Solution, solve
from trajopt.gaits.problem import WheelPhases
from trajopt.gaits.verify import floquet_multipliers, monodromy, playback
from trajopt.ocp.guesses import polyline


def passive(n_legs: int, slope: float, inertia: float) -> WheelParams:
    return THESIS_PHYSICAL.replace(
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


CASES = [(6, 0.2, 0.0), (10, 0.06, 0.2)]


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


@pytest.mark.parametrize("coordinate", range(4))
def test_the_monodromy_matrix_predicts_the_reference_simulation(
    one_step: Solution, coordinate: int
) -> None:
    column = monodromy(THESIS_PHYSICAL, one_step.phases)[:, coordinate]
    T, spare, size = one_step.duration, 0.002, 1e-6
    far_below = {"rtol": 1e-10, "atol": 1e-11}  # differences of 1e-6 to half a percent
    before_edge, after_edge = float(np.nextafter(T, 0)), float(np.nextafter(T, 2 * T))
    _, volts = playback([*one_step.phases, *one_step.phases])

    def end(change: np.ndarray) -> np.ndarray:
        """State at T + spare; the touchdown, not the clock, switches the voltage."""
        x0 = one_step.state(0.0) + change
        x0[0] = max(x0[0], THESIS_PHYSICAL.constants.a)
        step = simulate(
            THESIS_PHYSICAL,
            x0,
            lambda t, x: volts(min(t, before_edge), None),
            T + spare,
            breakpoints=[*one_step.breakpoints, T],
            **far_below,
        )
        touchdown = step.touchdowns[0]
        following = simulate(
            THESIS_PHYSICAL,
            touchdown.after,
            lambda t, x: volts(max(t + touchdown.time, after_edge), None),
            T + spare - touchdown.time,
            breakpoints=[T - touchdown.time] if touchdown.time < T else [],
            **far_below,
        )
        return following.x[-1]

    def later(x: np.ndarray) -> np.ndarray:
        law = lambda t, _: volts(max(t + T, after_edge), None)  # noqa: E731
        return simulate(THESIS_PHYSICAL, x, law, spare).x[-1]

    direction = np.eye(4)[coordinate] * size
    sides = (1, 0) if coordinate == 0 else (1, -1)  # a leg cannot start below the ground
    moved = (end(sides[0] * direction) - end(sides[1] * direction)) / (sides[0] - sides[1])
    at_T = one_step.state(T)
    at_T[0] += 1e-4  # clear of the guard, on both sides
    predicted = (later(at_T + size * column / 2) - later(at_T - size * column / 2)) / size
    assert np.allclose(moved / size, predicted, rtol=5e-3, atol=5e-3 * np.abs(predicted).max())
