from __future__ import annotations

from collections import OrderedDict

import numpy as np
import pytest

from agents.evaluate import Protocol, evaluate
from agents.policies import controller_policy
from rimless_gym import THESIS_PHYSICAL
from rimless_gym.equations import DOUBLE, SINGLE
from trajopt.feedback.catch import catch as catching
from trajopt.feedback.catch import value as value_module
from trajopt.feedback.catch.catch import MOST_KEPT, Catch, catch_for
from trajopt.feedback.catch.grid import StateGrid, Values, value
from trajopt.feedback.catch.options import Options, played
from trajopt.feedback.catch.value import NEVER
from trajopt.feedback.guard import Guarded
from trajopt.feedback.joined import NEAR, Joined
from trajopt.feedback.laws.lqr import design
from trajopt.feedback.orbit import squared_distances

P = THESIS_PHYSICAL
COUNTS = (9, 20, 13, 33)


@pytest.fixture(scope="module")
def law(held):
    return design(held)


@pytest.fixture(scope="module")
def catch(law):
    return Catch.to(law, NEAR, COUNTS)


def test_a_value_between_nodes_is_linear_in_every_coordinate_and_goes_round():
    grid = StateGrid.over(P, (4.0, 6.0), (3, 8, 5, 7))
    nodes = grid.single()[:, :4].reshape(3, 8, 5, 7, 4)
    plain = nodes @ [2.0, 0.0, -0.3, 0.7] + np.cos(nodes[..., 1])
    values = Values(plain, np.cos(grid.axis(1))[:, None] + 0.7 * grid.axis(3))
    phi, dphi, dtheta = 1.3, 0.4, -2.2
    for turn in (0, 2 * np.pi, -6 * np.pi):
        for theta, cos in ((-np.pi, -1.0), (0.0, 1.0), (np.pi / 8, 0.5 + np.sqrt(0.125))):
            wanted = 2 * phi - 0.3 * dphi + 0.7 * dtheta + cos
            found = value(values, grid, phi, theta + turn, dphi, dtheta, SINGLE)
            assert found == pytest.approx(wanted, abs=1e-5)
            double = value(values, grid, phi, theta + turn, dphi, dtheta, DOUBLE)
            assert double == pytest.approx(0.7 * dtheta + cos)


def test_beyond_the_grid_a_value_is_that_of_its_edge():
    grid = StateGrid.over(P, (4.0, 6.0), (3, 8, 5, 7))
    values = Values(grid.single()[:, 3].reshape(3, 8, 5, 7), np.zeros((8, 7)))
    assert value(values, grid, 1.3, 0.0, 0.0, 50.0, SINGLE) == pytest.approx(6.0)


def test_falling_costs_infinitely_much_and_a_foot_hardly_pressed_down_a_little():
    options = Options.of(P)
    states = np.zeros((2, 6))
    states[:, :4] = [[1.5, 0.0, 0.0, 0.0], [1.5, np.pi, 0.0, 25.0]]
    cost = played(P, options, states, np.zeros(2)).cost
    assert cost[0] == options.hold
    assert np.isinf(cost[1])


def test_the_gait_is_reached_within_seconds_of_rest_and_from_most_states(catch):
    rest = [value(catch.times, catch.grid, 1.0, t, 0.0, 0.0, DOUBLE) for t in (-0.4, 0.0, 0.4)]
    assert max(rest) < 10.0
    assert np.mean(catch.times.single < NEVER) > 0.5


def test_where_it_is_at_the_gait_no_time_is_left(catch, law):
    nodes = np.ascontiguousarray(catch.grid.single()[:, :4])
    there = squared_distances(nodes, law.data.orbit) < NEAR**2
    assert 0 < there.sum() < there.size
    assert (catch.times.single.ravel()[there] == 0.0).all()
    assert (catch.times.single.ravel()[~there] > 0.0).all()


def test_from_rest_and_from_random_starts_it_leads_to_the_gait(law, catch, held):
    controller = Guarded(P, Joined(law, catch))
    protocol = Protocol(starts=48, duration=24.0, window=8.0, alive=4.0)
    walks = evaluate(controller_policy(P, controller), P, protocol)
    assert walks.walking_share >= 0.9
    assert walks.speed == pytest.approx(held.speed, rel=0.01)


def test_it_is_a_function_of_the_state(catch):
    rng = np.random.default_rng(0)
    c = P.constants
    x = rng.uniform([c.a, -3, -2, -5], [c.b, 3, 2, 5], (20, 4))
    modes = np.arange(20) % 2
    together = catch(x, modes)
    alone = [catch(x[i], modes[i]) for i in range(20)]
    assert np.array_equal(together, alone)
    assert np.array_equal(catch(x), catch(x, np.full(20, SINGLE)))
    assert np.abs(together).max() <= P.voltage_limit


def test_its_voltage_does_not_jump_from_state_to_state(catch):
    x = np.zeros((4000, 4))
    x[:, 0], x[:, 1], x[:, 3] = P.constants.a, np.linspace(-1.0, 1.0, 4000), 1.0
    volts = catch(x, np.full(4000, DOUBLE))
    between_options = np.diff(catch.options.voltages)[0]
    assert np.abs(volts).max() > between_options
    assert np.abs(np.diff(volts)).max() < 0.25 * between_options


def test_the_same_gait_is_planned_only_once(law, monkeypatch):
    plans = []
    monkeypatch.setattr(Catch, "to", lambda *args: plans.append(args) or object())
    first = catch_for(law, 0.321)
    assert catch_for(law, 0.321) is first
    assert catch_for(law, 0.322) is not first
    assert len(plans) == 2


def test_only_the_last_few_plans_are_kept(law, monkeypatch):
    plans = []
    monkeypatch.setattr(Catch, "to", lambda *args: plans.append(args[1]) or object())
    monkeypatch.setattr(catching, "_KEPT", OrderedDict())
    distances = [0.2 + 0.01 * k for k in range(MOST_KEPT)]
    for near in (*distances, distances[0], 0.5):  # the first one is used again, so that it stays
        catch_for(law, near)
    assert plans == [*distances, 0.5]
    catch_for(law, distances[0])
    assert len(plans) == MOST_KEPT + 1
    catch_for(law, distances[1])
    assert plans[-1] == distances[1]


def test_a_grid_without_a_node_near_the_gait_is_refused(law):
    with pytest.raises(ValueError, match=r"near = 0.13, counts = \(3, 4, 3, 3\): .* raise"):
        Catch.to(law, NEAR, (3, 4, 3, 3))


def test_times_that_have_not_converged_are_refused(law, monkeypatch):
    monkeypatch.setattr(value_module, "SWEEPS", 1)
    with pytest.raises(RuntimeError, match=r"still change by .* s after 1 sweeps"):
        Catch.to(law, 1.0, (3, 8, 5, 7))


@pytest.mark.parametrize(
    ("near", "counts", "message"),
    [
        (np.nan, COUNTS, "near = nan: must be finite"),
        (-1.0, COUNTS, "near = -1.0: must be greater than 0"),
        (NEAR, (9, 24, 17), r"counts = \(9, 24, 17\): must be four"),
        (NEAR, (9, 24, 17, 1), "counts = 1: must be an integer of at least 2"),
    ],
)
def test_a_plan_that_makes_no_sense_is_refused_at_once(near, counts, message, law):
    with pytest.raises(ValueError, match=message):
        Catch.to(law, near, counts)


@pytest.mark.parametrize(
    ("x", "mode", "message"),
    [
        (np.full((1, 4), np.nan), SINGLE, "x: has"),
        (np.zeros((1, 3)), SINGLE, r"x: has shape \(1, 3\)"),
        (np.zeros((1, 4)), 7, "mode = 7: must be"),
    ],
)
def test_what_is_no_state_or_mode_is_refused_as_by_a_law(x, mode, message, catch, law):
    for controller in (catch, law):
        with pytest.raises(ValueError, match=message):
            controller(x, mode)


def test_its_repr_is_one_short_line(catch):
    assert repr(catch) == f"Catch(THESIS_PHYSICAL, {' x '.join(map(str, COUNTS))} nodes)"
