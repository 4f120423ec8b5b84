import dataclasses
import json
import math

import numpy as np
import pytest

from agents.conditions import Conditions
from agents.evaluate import Evaluation, evaluate
from agents.periods import steps_per_period
from agents.policies import controller_policy
from agents.protocol import PROTOCOL, Protocol
from agents.rollout import Rollout, draw_starts
from agents.verdicts import VERDICTS
from rimless_gym import PROTOTYPE, THESIS_PHYSICAL, Task
from rimless_gym.kernel.stepping import DPHI, MODE, PHI, STATE_SIZE, THETA

# So short that some starts still walk on their first momentum.
SMALL = Protocol(starts=24, seed=3, duration=1.5, window=1.2, alive=1.2)

# A ground on which no foot slips: what walks for a moment does so by slipping, most of the time.
STICKY = THESIS_PHYSICAL.replace(friction=1e6)


def push(states, observations):
    """A policy under which some starts walk for a while, some fall and some rest."""
    return np.clip(0.4 * observations[:, 3] - 0.6 * observations[:, 1], -1, 1).astype(float)


def rest(states, observations):
    return np.zeros(len(states))


def test_the_published_protocol_has_the_documented_numbers():
    assert dataclasses.astuple(PROTOCOL)[0] == 128
    assert (PROTOCOL.duration, PROTOCOL.window, PROTOCOL.alive) == (50.0, 30.0, 10.0)
    assert 0 < (draw_starts(THESIS_PHYSICAL, 128, PROTOCOL.seed)[:, MODE] == 1).mean() < 1


def test_machines_and_tasks_may_be_given_by_name_and_fields():
    by_name = evaluate(push, "PROTOTYPE", SMALL, task={"distance_weight": 0.8})
    assert by_name.to_dict() == evaluate(push, PROTOTYPE, SMALL, task=Task(0.8)).to_dict()


def test_an_evaluation_is_deterministic():
    first, second = (evaluate(push, protocol=SMALL).to_dict() for _ in range(2))
    assert first == second


def test_a_start_gives_the_same_result_in_any_batch_and_order():
    starts = draw_starts(THESIS_PHYSICAL, SMALL.starts, SMALL.seed)
    together = evaluate(push, THESIS_PHYSICAL, SMALL)
    order = np.random.default_rng(0).permutation(len(starts))[:9]
    some = evaluate(push, THESIS_PHYSICAL, SMALL, starts=starts[order])
    for name in ("walking", "fallen", "speeds", "cots", "periods"):
        np.testing.assert_array_equal(getattr(some, name), getattr(together, name)[order], name)


def test_a_policy_of_zeros_rests_and_its_cost_of_transport_is_nan():
    result = evaluate(rest, THESIS_PHYSICAL, dataclasses.replace(SMALL, duration=15.0))
    assert result.walking_share == 0.0
    assert math.isnan(result.cot)
    assert math.isnan(result.speed)
    assert result.steps_per_period == 0
    resting = ~result.fallen
    assert resting.mean() > 0.5
    assert result.objective <= 0.0


def test_figures_are_ratios_of_sums_over_the_measured_window():
    result = evaluate(push, STICKY, SMALL)
    assert 0 < result.walking.sum() < SMALL.starts
    walking = np.flatnonzero(result.walking)
    energy = distance = time = regenerated = 0.0
    least = np.inf
    starts = draw_starts(THESIS_PHYSICAL, SMALL.starts, SMALL.seed)
    for index, interval in enumerate(Rollout(Conditions(STICKY), push, starts, 150)):
        if index < 30:
            continue
        some = np.isin(interval.running, walking)
        rows = {name: values[some] for name, values in interval.info.items()}
        energy += rows["electrical_positive"].sum()
        regenerated += rows["electrical"].sum()
        distance += rows["distance"].sum()
        time += rows["elapsed"].sum()
        least = min(least, rows["min_normal_force"].min())
    weight = THESIS_PHYSICAL.weight
    assert result.cot == pytest.approx(energy / (weight * distance), rel=1e-12)
    assert result.cot_with_regeneration == pytest.approx(regenerated / (weight * distance))
    assert result.speed == pytest.approx(distance / time, rel=1e-12)
    assert result.min_normal_force == least
    assert result.min_normal_force_over_weight == least / weight


def test_idle_power_is_paid_for_while_walking():
    idle = STICKY.replace(idle_power=2.0)
    without, with_idle = evaluate(push, STICKY, SMALL), evaluate(push, idle, SMALL)
    assert with_idle.speed == without.speed
    extra = 2.0 / (THESIS_PHYSICAL.weight * without.speed)
    assert with_idle.cot - without.cot == pytest.approx(extra)


def test_a_fallen_start_does_not_count_as_walking():
    result = evaluate(topple, THESIS_PHYSICAL, dataclasses.replace(SMALL, duration=4.0))
    assert result.fallen.any()
    assert not (result.fallen & result.walking).any()


def topple(states, observations):
    return np.ones(len(states))


def test_the_objective_is_the_reward_per_second_including_falls():
    task = Task(distance_weight=3.5, fall_penalty=2.0, slip_penalty=3.0)
    result = evaluate(topple, THESIS_PHYSICAL, SMALL, task=task)
    starts = draw_starts(THESIS_PHYSICAL, SMALL.starts, SMALL.seed)
    reward, fallen = 0.0, np.zeros(SMALL.starts, dtype=bool)
    for index, interval in enumerate(Rollout(Conditions(THESIS_PHYSICAL), topple, starts, 150)):
        fallen[interval.running] = interval.info["failure"] != 0
        if index >= 30:
            rows = interval.info
            reward += 3.5 * rows["distance"].sum()
            reward -= rows["electrical_positive"].sum() / THESIS_PHYSICAL.weight
            slid = np.maximum(rows["distance"], 0.0) + 3.0 * rows["elapsed"]
            reward -= 3.5 * slid[rows["slips"]].sum()
    assert 0 < fallen.sum() < SMALL.starts
    np.testing.assert_array_equal(result.fallen, fallen)
    mean = (reward - 7.0 * fallen.sum()) / SMALL.starts
    assert result.objective == pytest.approx(mean / SMALL.window, rel=1e-12)


def rolling(*rates):
    """Starts in mid-stance with these leg rates, the pendulum level on the side they go to."""
    starts = np.zeros((len(rates), STATE_SIZE))
    starts[:, PHI], starts[:, DPHI] = np.pi / 2, rates
    starts[:, THETA] = np.pi / 2 * np.sign(rates)
    return starts


def test_walking_backward_does_not_count_as_walking():
    starts = rolling(3.0, -3.0)
    protocol = Protocol(starts=2, seed=0, duration=0.6, window=0.6, alive=0.6)
    steps = np.zeros(2)
    for interval in Rollout(Conditions(THESIS_PHYSICAL), rest, starts, 60):
        steps[interval.running] += interval.info["steps"]
    assert steps[0] > 0 > steps[1]
    result = evaluate(rest, STICKY, protocol, starts=starts)
    assert not result.fallen.any()
    assert result.verdicts == ("walks", "stops")
    np.testing.assert_array_equal(result.walking, [True, False])


def test_a_walk_that_came_to_rest_before_the_end_does_not_count():
    starts = rolling(3.0)
    whole = Protocol(starts=1, seed=0, duration=8.0, window=8.0, alive=8.0)
    end = dataclasses.replace(whole, alive=1.0)
    assert evaluate(rest, STICKY, whole, starts=starts).walking_share == 1.0
    result = evaluate(rest, STICKY, end, starts=starts)
    assert result.walking_share == 0.0
    assert result.faults == {"stops": 1}


def test_a_walk_counts_where_the_ground_bears_its_friction_demand_and_no_less():
    """The same motion on other grounds: what it needs is measured, whether or not it counts."""
    protocol = Protocol(starts=1, seed=0, duration=0.6, window=0.6, alive=0.6)
    needs = evaluate(rest, STICKY, protocol, starts=rolling(2.0))
    assert needs.verdicts == ("walks",)
    stance, impulse = needs.friction_demand, needs.impulse_friction_demand
    assert 0 < min(stance, impulse) < max(stance, impulse)
    for factor, verdict in ((1.001, "walks"), (0.99, BREACH[stance > impulse])):
        ground = THESIS_PHYSICAL.replace(friction=factor * max(stance, impulse))
        result = evaluate(rest, ground, protocol, starts=rolling(2.0))
        assert result.verdicts == (verdict,)
        assert result.friction_demand == stance
        assert result.min_normal_force == needs.min_normal_force
        assert result.walking_share == (verdict == "walks")
        assert math.isnan(result.cot) == (verdict != "walks")


BREACH = {True: "slips", False: "slips_at_touchdown"}


def test_a_pendulum_that_sweeps_the_floor_does_not_count_unless_there_is_no_floor():
    protocol = Protocol(starts=1, seed=0, duration=0.6, window=0.6, alive=0.6)
    for length, verdict in ((0.17, "touches"), (0.19, "walks"), (0.14, "walks")):
        machine = STICKY.replace(pendulum_length=length, pendulum_mass=0.2)
        result = evaluate(rest, machine, protocol, starts=hanging(3.0))
        assert result.verdicts == (verdict,), length
        assert (result.min_clearance < 0) == (length > 0.15)


def hanging(rate):
    """A start in mid-stance with the pendulum hanging."""
    start = rolling(rate)
    start[:, THETA] = 0.0
    return start


def test_verdicts_add_up_to_the_starts():
    result = evaluate(push, THESIS_PHYSICAL, SMALL)
    assert len(result.verdicts) == SMALL.starts
    assert set(result.verdicts) <= set(VERDICTS)
    assert sum(result.faults.values()) + result.walking.sum() == SMALL.starts
    assert {"slips", "stops"} <= set(result.faults)
    np.testing.assert_array_equal(result.walking, [v == "walks" for v in result.verdicts])
    np.testing.assert_array_equal(result.fallen, [v == "falls" for v in result.verdicts])


def test_a_policy_that_writes_into_its_inputs_changes_nothing_but_its_action():
    def vandal(states, observations):
        action = push(states, observations)
        states[:] = np.nan
        observations[:] = np.nan
        return action

    starts = draw_starts(THESIS_PHYSICAL, 6, 1)
    kept = starts.copy()
    walks = (Rollout(Conditions(THESIS_PHYSICAL), policy, starts, 40) for policy in (push, vandal))
    for mine, theirs in zip(*walks, strict=True):
        for name in ("running", "states", "observations", "actions", "after"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name), name)
        for name, values in mine.info.items():
            np.testing.assert_array_equal(values, theirs.info[name], name)
    np.testing.assert_array_equal(starts, kept)


@pytest.mark.parametrize("period", range(1, 7))
def test_a_walk_that_repeats_after_some_steps_has_that_period(period):
    cycle = np.random.default_rng(period).normal(size=(period, 4))
    scatter = 1e-3 * np.random.default_rng(9).normal(size=(8 * period, 4))
    assert steps_per_period(np.tile(cycle, (8, 1)) + scatter) == period


def test_a_walk_that_never_repeats_has_period_zero():
    assert steps_per_period(np.random.default_rng(0).normal(size=(60, 4))) == 0
    assert steps_per_period(np.zeros((0, 4))) == 0


def test_an_evaluation_is_plain_json():
    result = evaluate(rest, protocol=dataclasses.replace(SMALL, duration=15.0))
    values = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert values["cot"] is None
    assert set(values) == {field.name for field in dataclasses.fields(Evaluation)}


def test_a_policy_that_gives_nan_or_a_wrong_shape_is_refused():
    for bad in (lambda s, o: np.full(len(s), np.nan), lambda s, o: np.zeros((len(s), 1))):
        with pytest.raises(ValueError, match="one number in"):
            evaluate(bad, protocol=SMALL)
    with pytest.raises(TypeError, match=r"policy's actions = None: must be real numbers"):
        evaluate(lambda states, observations: None, protocol=SMALL)


def test_controllers_are_clipped_to_the_voltage_limit():
    policy = controller_policy(THESIS_PHYSICAL, lambda x, mode: np.full(len(x), 1e3))
    starts = draw_starts(THESIS_PHYSICAL, 3, 0)
    np.testing.assert_array_equal(policy(starts, None), 1.0)


def test_a_protocol_whose_window_is_longer_than_its_walks_is_refused():
    with pytest.raises(ValueError, match="window"):
        Protocol(duration=10.0, window=20.0)


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"starts": math.nan}, TypeError, "starts = nan: must be an integer"),
        ({"starts": 0}, ValueError, "starts = 0"),
        ({"seed": -1}, ValueError, "seed = -1"),
        ({"duration": math.inf}, ValueError, "duration = inf"),
        ({"window": math.nan}, ValueError, "window = nan"),
        ({"alive": "x"}, TypeError, "alive = 'x'"),
        ({"alive": 1e-3}, ValueError, "alive = 0.001 s: must be at least 0.01 s"),
    ],
)
def test_invalid_protocols_are_refused_by_name(settings, error, message):
    with pytest.raises(error, match=message):
        Protocol(**settings)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"policy": 3}, TypeError, "policy = 3: must be a function"),
        ({"params": None}, TypeError, "params = None"),
        ({"params": "CONCRETE"}, ValueError, "unknown preset 'CONCRETE': choose from"),
        ({"protocol": 10}, TypeError, "protocol = 10"),
        ({"task": "walk"}, TypeError, "task = 'walk'"),
        ({"progress": "yes"}, TypeError, "progress = 'yes'"),
        ({"starts": np.zeros(4)}, ValueError, "starts: of shape"),
        ({"starts": np.full((2, 6), math.nan)}, ValueError, "starts: must all be finite"),
        ({"starts": np.full((2, 6), 3.0)}, ValueError, "starts: modes are"),
        ({"ranges": {"n_legs": (4, 5)}}, ValueError, "'n_legs' cannot be drawn"),
        ({"ranges": [1]}, TypeError, r"ranges = \[1\]: give a mapping"),
        ({"disturbances": {"wind": 1}}, ValueError, "'wind' is not a field of Disturbances"),
        ({"disturbances": 3}, TypeError, "disturbances = 3"),
    ],
)
def test_invalid_arguments_of_an_evaluation_are_refused_by_name(arguments, error, message):
    with pytest.raises(error, match=message):
        evaluate(**({"policy": lambda states, observations: np.zeros(len(states))} | arguments))
