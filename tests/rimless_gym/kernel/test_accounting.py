"""What the kernel accounts besides energies, and what the environment makes of it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rimless_gym import (
    PROTOTYPE,
    THESIS_NOMINAL,
    THESIS_PHYSICAL,
    WheelParams,
    equations,
    hybrid,
    simulate,
)
from rimless_gym.energy import ROW, Row, balance
from rimless_gym.envs import starts
from rimless_gym.envs.env import RimlessWheelEnv
from rimless_gym.kernel.stepping import STATE_SIZE, advance

MACHINES = {
    "THESIS_NOMINAL": THESIS_NOMINAL,
    "THESIS_PHYSICAL": THESIS_PHYSICAL,
    "PROTOTYPE": PROTOTYPE,
    "relabel law": THESIS_PHYSICAL.replace(impact_law="relabel"),
    "slope 0.1, 7 legs": THESIS_PHYSICAL.replace(slope=0.1, n_legs=7, drag=0.3),
}
arrays = equations.equations(np.sin, np.cos, sqrt=np.sqrt)  # of arrays of states
SMOOTH = [name for name in MACHINES if name != "PROTOTYPE"]  # it is slow in the reference


def random_states(params: WheelParams, rng: np.random.Generator, count: int) -> np.ndarray:
    p, states = params.constants, np.zeros((count, STATE_SIZE))
    states[:, 0] = rng.uniform(p.a, p.b, count)
    states[:, 1] = rng.uniform(-math.pi, math.pi, count)
    states[:, 2] = rng.uniform(-3, 4, count)
    states[:, 3] = rng.uniform(-8, 8, count)
    return states


def clearances(states: np.ndarray, params: WheelParams) -> np.ndarray:
    p = params.constants
    return np.array([hybrid.pendulum_clearance(x[0], x[1], p) for x in states])


@pytest.mark.parametrize("name", SMOOTH)
def test_impulses_demand_the_same_friction_in_kernel_and_reference(name: str) -> None:
    params, rng = MACHINES[name], np.random.default_rng(8)
    demands = []
    for start in random_states(params, rng, 4):
        volts, state = rng.uniform(-15, 15, 20), start.copy()
        reference = simulate(params, start[:4], volts, 0.2)
        rows = [advance(params, state[None], np.array([v]), pull=math.inf)[0] for v in volts]
        demand = max(out[ROW.impulse_friction_demand] for out in rows)
        assert demand == pytest.approx(reference.impulse_friction_demand, rel=1e-6)
        demands.append(demand)
    if params.impact_law == "plastic":  # under the other law the impulse is vertical
        assert np.count_nonzero(demands) > 0


@pytest.mark.parametrize("name", SMOOTH)
def test_the_clearance_is_that_of_the_reference(name: str) -> None:
    params, rng = MACHINES[name], np.random.default_rng(10)
    for start in random_states(params, rng, 3):
        volts, state = rng.uniform(-15, 15, 20), start.copy()
        reference = simulate(params, start[:4], volts, 0.2)
        rows = [advance(params, state[None], np.array([v]), pull=math.inf)[0] for v in volts]
        reported = min(out[ROW.clearance] for out in rows)
        lowest = clearances(reference.state(np.linspace(0, 0.2, 801)), params).min()
        assert reported >= min(lowest, reference.clearance) - 1e-4  # up to sampling
        assert reported == pytest.approx(reference.clearance, abs=5e-3 * params.leg_length)


@pytest.mark.parametrize(  # with few legs, touchdowns end on two feet
    ("n_legs", "pull"), [(3, 0.0), (5, math.inf)]
)
def test_a_foot_that_lifts_off_at_once_leaves_no_trace_in_the_extremes(
    n_legs: int, pull: float
) -> None:
    params, rng = THESIS_PHYSICAL.replace(n_legs=n_legs), np.random.default_rng(14)
    at_once = after_touchdown = 0
    for mode, start in enumerate(random_states(params, rng, 200)):
        mode %= 2
        start[3], start[4] = rng.uniform(-3, 3), mode
        if mode == equations.DOUBLE:
            start[[0, 2]] = params.constants.a, 0.0
        volts, state = rng.uniform(-20, 20, 1), start[None].copy()
        reference = simulate(
            params, start[:4], volts, 0.01, mode=equations.MODE_NAMES[mode], pull=pull
        )
        out = advance(params, state, volts, pull=pull)[0]
        # The two take different steps, but within a step forces hardly change.
        least = pytest.approx(reference.min_normal_force, abs=0.02 * params.weight)
        assert out[ROW.min_normal_force] == least
        if reference.min_normal_force > 0.1 * params.weight:
            assert out[ROW.friction_demand] == pytest.approx(reference.friction_demand, rel=0.1)
        kinds = [event.kind for event in reference.events]
        at_once += kinds[:1] == ["lift_off"] and reference.events[0].time == 0.0
        after_touchdown += kinds[:2] == ["touchdown", "lift_off"]
    assert at_once > 2
    assert after_touchdown > 0 or n_legs > 3


@pytest.mark.parametrize("mount", ["wheel", "frame"])
@pytest.mark.parametrize("rotor_inertia", [0.0, 1e-6, 1e-4])
def test_the_drag_pole_is_a_tight_bound_on_how_fast_the_air_brakes(
    mount: str, rotor_inertia: float
) -> None:
    params = THESIS_PHYSICAL.replace(motor_mount=mount, rotor_inertia=rotor_inertia, drag=1.0)
    p, without = params.constants, params.replace(drag=0.0).constants
    dphi, nudge = 2.0, 1e-6
    phi, theta = np.random.default_rng(0).uniform([p.a, -math.pi], [p.b, math.pi], (2000, 2)).T
    slopes = [
        np.subtract(*(arrays.single_stance(phi, theta, v, 0.0, 0.0, c)[0] for v in at)) / nudge
        for c, at in ((without, (dphi + nudge, dphi)), (p, (dphi + nudge, dphi)))
    ]
    most = (slopes[0] - slopes[1]).max()
    assert most <= arrays.drag_pole(dphi, 0.0, p) * (1 + 1e-3)
    assert most == pytest.approx(arrays.drag_pole(dphi, 0.0, p), rel=5e-3)


def test_energy_balances_with_stiff_hub_friction() -> None:
    rng = np.random.default_rng(11)
    for damping in (1.0, 30.0, 300.0):
        params = THESIS_PHYSICAL.replace(hub_damping=damping)
        out = advance(params, random_states(params, rng, 100), rng.uniform(-20, 20, 100), pull=1e9)
        terms = np.array(balance(Row(*out.T)._asdict()))
        assert np.abs(terms.sum(axis=0)).max() < 1e-8 * max(1.0, np.abs(terms).max())


def test_impulses_and_forces_make_a_step_slip_but_not_on_rougher_ground() -> None:
    params, rng, seen = THESIS_PHYSICAL, np.random.default_rng(13), set()
    env = RimlessWheelEnv()
    for start in random_states(params, rng, 150):
        start[0] = params.constants.b - 0.01
        if starts.normal_force(params, start) <= 0:
            continue
        options = {"state": start[:4], "params": params}
        action = rng.uniform(-1, 1, 1).astype(np.float32)
        env.reset(options=options)
        env.step(action)
        info = env.measurements
        demands = info["friction_demand"], info["impulse_friction_demand"]
        if info["failure"] == 0 and abs(demands[0] - demands[1]) > 0.01 * max(demands):
            seen.add(demands[0] > demands[1])
            for friction, slips in ((np.mean(demands), True), (max(demands) + 1e-9, False)):
                env.reset(options=options | {"params": params.replace(friction=friction)})
                env.step(action)
                assert env.measurements["slips"] is slips
    assert seen == {True, False}
