"""The start-up controller: its grid, its costs to go, and where it leads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents.evaluate import Protocol, evaluate
from agents.gaps import reward_rate
from agents.rollout import controller_policy
from rimless_gym import BUILDABLE, THESIS_PHYSICAL
from rimless_gym.energy import ROW
from rimless_gym.equations import DOUBLE, SINGLE
from rimless_gym.kernel.stepping import advance
from trajopt import periodic_gait
from trajopt.feedback import laws
from trajopt.feedback import startup as module
from trajopt.feedback.controller import NEAR, ContactGuard, SwitchingController
from trajopt.feedback.orbit import squared_distances
from trajopt.feedback.startup import (
    HOLD,
    MOST_CACHED,
    NEVER,
    CostToGo,
    StartUpController,
    StateGrid,
    Weights,
    cost_at,
    lost_return,
    near_for,
    simulated,
    startup_for,
    voltages,
)

P = THESIS_PHYSICAL
COUNTS = (7, 18, 9, 25)
SMALL = (3, 8, 5, 7)
WEIGHTS = Weights(time=0.3, energy=0.02, distance=-0.5)


@pytest.fixture(scope="module")
def startup(law):
    fastest = Weights(time=1.0, energy=0.0, distance=0.0)  # its grid may be coarser
    return StartUpController.to(P, law.data.orbit, NEAR, fastest, COUNTS)


def test_a_cost_between_nodes_is_linear_in_every_coordinate_and_goes_round():
    grid = StateGrid.over(P, (4.0, 6.0), SMALL)
    nodes = grid.single()[:, :4].reshape(*SMALL, 4)
    plain = nodes @ [2.0, 0.0, -0.3, 0.7] + np.cos(nodes[..., 1])
    to_go = CostToGo(plain, np.cos(grid.axis(1))[:, None] + 0.7 * grid.axis(3))
    phi, dphi, dtheta = 1.3, 0.4, -2.2
    for turn in (0, 2 * np.pi, -6 * np.pi):
        for theta, cos in ((-np.pi, -1.0), (0.0, 1.0), (np.pi / 8, 0.5 + np.sqrt(0.125))):
            wanted = 2 * phi - 0.3 * dphi + 0.7 * dtheta + cos
            single = cost_at(to_go, grid, phi, theta + turn, dphi, dtheta, SINGLE)
            assert single == pytest.approx(wanted, abs=1e-5)
            double = cost_at(to_go, grid, phi, theta + turn, dphi, dtheta, DOUBLE)
            assert double == pytest.approx(0.7 * dtheta + cos)


def test_beyond_the_grid_a_cost_is_that_of_its_edge():
    grid = StateGrid.over(P, (4.0, 6.0), SMALL)
    to_go = CostToGo(grid.single()[:, 3].reshape(SMALL), np.zeros((8, 7)))
    assert cost_at(to_go, grid, 1.3, 0.0, 0.0, 50.0, SINGLE) == pytest.approx(6.0)


def test_a_fall_costs_infinitely_much():
    states = np.zeros((2, 6))
    states[:, :4] = [[1.5, 0.0, 0.0, 0.0], [1.5, np.pi, 0.0, 25.0]]
    _, cost = simulated(P, states, np.zeros(2), WEIGHTS)
    assert np.isinf(cost).tolist() == [False, True]


def test_a_moment_costs_the_weighted_sum_of_time_energy_and_distance():
    states = np.zeros((1, 6))
    states[0, :4] = [1.5, 0.0, 0.4, 1.0]
    machine, volts = P.replace(idle_power=2.0), np.array([1.0])
    _, cost = simulated(machine, states, volts, WEIGHTS)
    row = advance(machine, states.copy(), volts, HOLD)[0]
    energy = row[ROW.electrical_positive] + 2.0 * HOLD
    assert row[ROW.distance] > 0.0
    assert cost[0] == pytest.approx(0.3 * HOLD + 0.02 * energy - 0.5 * row[ROW.distance])


def test_the_gait_is_reached_within_seconds_of_rest_and_from_most_states(startup, law):
    to_go, grid = startup.to_go, startup.grid
    rest = [cost_at(to_go, grid, 1.0, t, 0.0, 0.0, DOUBLE) for t in (-0.4, 0.0, 0.4)]
    assert max(rest) < 10.0
    assert np.mean(to_go.single < NEVER) > 0.5
    distances = squared_distances(np.ascontiguousarray(grid.single()[:, :4]), law.data.orbit)
    at_the_gait = distances < NEAR**2
    assert 0 < at_the_gait.sum() < at_the_gait.size
    assert np.array_equal(to_go.single.ravel() == 0.0, at_the_gait)


def test_from_rest_and_from_random_starts_it_leads_to_the_gait(law, startup, held):
    controller = ContactGuard(P, SwitchingController(law, startup))
    protocol = Protocol(starts=24, duration=20.0, window=6.0, alive=4.0)
    walks = evaluate(controller_policy(P, controller), P, protocol)
    assert walks.walking_share >= 0.9
    assert walks.speed == pytest.approx(held.speed, rel=0.02)


@pytest.mark.slow
def test_little_of_the_return_is_lost_before_the_gait(held):
    controller = laws.design("lqr", held)
    protocol = Protocol(starts=24, duration=20.0, window=6.0, alive=4.0)
    walks = evaluate(controller_policy(P, controller), P, protocol)
    assert walks.walking_share >= 0.95
    assert np.mean(walks.returns) > 0.65 * protocol.duration * reward_rate(held)


def test_nothing_is_lost_on_the_gait(held):
    weights, distance = lost_return(P, held.speed, held.cot), held.speed * held.duration
    energy = held.cot * P.weight * distance
    lost = weights.time * held.duration + weights.energy * energy + weights.distance * distance
    assert lost == pytest.approx(0.0, abs=1e-12)


def test_no_moment_on_the_way_to_an_expensive_gait_is_rewarded():
    weights = lost_return(P, speed=0.5, cot=0.7)
    assert weights.time > 0.0
    assert min(weights) >= 0.0


@pytest.mark.slow
def test_it_leads_to_a_fast_gait_whose_pendulum_hardly_moves(law):
    fast = periodic_gait(BUILDABLE, 1.3)
    controller = laws.design("lqr", fast)
    orbit = controller.controller.law.data.orbit
    assert near_for(BUILDABLE, orbit) > NEAR == near_for(P, law.data.orbit)
    grippy = BUILDABLE.replace(friction=1.0)  # the gait uses all grip of the machine's own
    protocol = Protocol(starts=24, duration=14.0, window=4.0, alive=3.0)
    walks = evaluate(controller_policy(BUILDABLE, controller), grippy, protocol)
    assert walks.walking_share >= 0.8
    assert walks.speed == pytest.approx(fast.speed, rel=0.01)


def test_it_is_a_function_of_the_state_within_the_voltage_limit(startup):
    rng, c = np.random.default_rng(0), P.constants
    x = rng.uniform([c.a, -3, -2, -5], [c.b, 3, 2, 5], (20, 4))
    modes = np.arange(20) % 2
    together = startup(x, modes)
    assert np.array_equal(together, [startup(x[i], modes[i]) for i in range(20)])
    assert np.array_equal(startup(x), startup(x, np.full(20, SINGLE)))
    assert np.abs(together).max() <= P.voltage_limit


def test_its_voltage_does_not_jump_from_state_to_state(startup):
    x = np.zeros((4000, 4))
    x[:, 0], x[:, 1], x[:, 3] = P.constants.a, np.linspace(-1.0, 1.0, 4000), 1.0
    volts, between_choices = startup(x, np.full(4000, DOUBLE)), np.diff(voltages(P))[0]
    assert np.abs(volts).max() > between_choices
    assert np.abs(np.diff(volts)).max() < 0.25 * between_choices


def test_it_is_computed_once_for_each_of_the_last_few_gaits(law, monkeypatch):
    computed = []
    monkeypatch.setattr(StartUpController, "to", lambda *args: computed.append(args[2]) or object())
    monkeypatch.setattr(module, "_CACHE", {})
    distances = [0.2 + 0.01 * k for k in range(MOST_CACHED)]
    for near in (*distances, distances[0], 0.5):  # the first one is used again, so that it stays
        startup_for(P, law.data.orbit, near, WEIGHTS)
    assert computed == [*distances, 0.5]
    startup_for(P, law.data.orbit, distances[0], WEIGHTS)
    assert len(computed) == MOST_CACHED + 1
    startup_for(P, law.data.orbit, distances[1], WEIGHTS)
    assert computed[-1] == distances[1]


def test_it_is_computed_once_for_all_processes(
    law, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(module, "COUNTS", (5, 16, 11, 13))
    monkeypatch.setattr(module, "_CACHE", {})
    first = startup_for(P, law.data.orbit, 0.6, WEIGHTS, tmp_path / "stored")
    monkeypatch.setattr(module, "_CACHE", {})  # as in another process
    monkeypatch.delattr(StartUpController, "to")
    second = startup_for(P, law.data.orbit, 0.6, WEIGHTS, tmp_path / "stored")
    x = np.array([[1.5, 0.2, -2.0, 1.0], [1.6, -2.0, -1.0, -9.0]])
    np.testing.assert_array_equal(first(x), second(x))


@pytest.mark.parametrize(
    ("near", "counts", "error", "message"),
    [
        (np.nan, COUNTS, ValueError, "near = nan: must be finite"),
        (NEAR, (3, 4, 3, 3), ValueError, r"counts = \(3, 4, 3, 3\): .* raise"),
        (1.0, SMALL, ValueError, "still change by .* m after 1 sweeps"),
    ],
)
def test_what_leads_nowhere_is_refused(near, counts, error, message, law, monkeypatch):
    monkeypatch.setattr(module, "SWEEPS", 1)
    with pytest.raises(error, match=message):
        StartUpController.to(P, law.data.orbit, near, WEIGHTS, counts)
