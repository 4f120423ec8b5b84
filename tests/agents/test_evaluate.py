"""The evaluation protocol: its numbers, which starts count, and what is measured of them."""

import dataclasses
import json
import math

import numpy as np
import pytest

from agents import load_policy
from agents.conditions import Conditions
from agents.evaluate import (
    PROTOCOL,
    SHORT_PROTOCOL,
    TRAINING_PROTOCOL,
    Evaluation,
    Protocol,
    bootstrap_interval,
    commands_within,
    evaluate,
    evaluate_commanded,
    interquartile_mean,
)
from agents.outcomes import OUTCOMES, steps_per_period
from agents.rollout import Rollout, draw_starts, learned_policy
from rimless_gym import BUILDABLE, THESIS_PHYSICAL, Task
from rimless_gym.envs.speed import TASK
from rimless_gym.kernel.stepping import DPHI, MODE, PHI, STATE_SIZE, THETA

# So short that some starts still walk on their first momentum.
SMALL = Protocol(starts=24, seed=3, duration=1.5, window=1.2, alive=1.2)

# One start, all of whose walk is measured.
WHOLE = Protocol(starts=1, seed=0, duration=0.6, window=0.6, alive=0.6)

# At commanded speeds.
COMMANDED = Protocol(starts=16, duration=16.0, window=8.0, alive=4.0)

# A ground on which no foot slips: what walks for a moment does so by slipping, most of the time.
STICKY = THESIS_PHYSICAL.replace(friction=1e6)

NOISE = {"sensor_noise": {"leg_angle": 0.01, "pendulum_angle": 0.3, "leg_rate": 0.2}}
PUSHES = {"pushes": {"rate": 5.0, "impulse": (0.2, 0.5)}}


def push(states, observations):
    """A policy under which some starts walk for a while, some fall and some rest."""
    return np.clip(0.4 * observations[:, 3] - 0.6 * observations[:, 1], -1, 1).astype(float)


def rest(states, observations):
    return np.zeros(len(states))


def topple(states, observations):
    return np.ones(len(states))


def rolling(*rates, theta=math.pi / 2):
    """Starts in mid-stance with these leg rates, the pendulum level on the side they go to."""
    starts = np.zeros((len(rates), STATE_SIZE))
    starts[:, PHI], starts[:, DPHI] = np.pi / 2, rates
    starts[:, THETA] = theta * np.sign(rates)
    return starts


def test_the_published_protocols_have_the_documented_numbers():
    assert PROTOCOL == Protocol(128, 20150501, 50.0, 30.0, 10.0) == Protocol()
    assert Protocol(48, 20150502, 20.0, 10.0, 5.0) == SHORT_PROTOCOL
    assert Protocol(48, 20150502, 50.0, 10.0, 5.0) == TRAINING_PROTOCOL
    resting = draw_starts(THESIS_PHYSICAL, 128, PROTOCOL.seed)[:, MODE] == 1
    assert 0.15 < resting.mean() < 0.35


def test_starts_machines_and_disturbances_follow_the_seed_of_the_protocol():
    """Start i has the seed's i-th start, and draws its machine and disturbances from seed + i."""
    rough = {"ranges": {"pendulum_mass": (2.0, 2.4)}, "disturbances": PUSHES | NOISE}
    result = evaluate(push, STICKY, SMALL, **rough)
    starts = draw_starts(STICKY, SMALL.starts, SMALL.seed)
    conditions = Conditions.of(STICKY, rough["ranges"], rough["disturbances"])
    least = np.full(SMALL.starts, np.inf)
    walks = Rollout(conditions, push, starts, 150, SMALL.seed)
    for k, interval in enumerate(walks):
        if k >= 30:
            i = interval.running
            least[i] = np.minimum(least[i], interval.info["min_normal_force"])
    assert result.walking.any()
    assert result.min_normal_force == least[~np.isin(result.outcomes, ("falls", "stops"))].min()
    assert len({machine.pendulum_mass for machine in walks.machines}) == SMALL.starts
    assert result.to_dict() == evaluate(push, STICKY, SMALL, **rough).to_dict()
    other = dataclasses.replace(SMALL, seed=4)
    assert evaluate(push, STICKY, other, starts=starts, **rough).objective != result.objective


def test_a_start_gives_the_same_result_in_any_batch_and_order():
    starts = draw_starts(THESIS_PHYSICAL, SMALL.starts, SMALL.seed)
    together = evaluate(push, THESIS_PHYSICAL, SMALL)
    order = np.random.default_rng(0).permutation(len(starts))[:9]
    some = evaluate(push, THESIS_PHYSICAL, SMALL, starts=starts[order])
    for name in ("walking", "fallen", "speeds", "cots", "periods"):
        np.testing.assert_array_equal(getattr(some, name), getattr(together, name)[order], name)


def test_every_start_may_have_a_machine_of_its_own():
    starts, heavy = draw_starts(STICKY, 8, SMALL.seed), STICKY.replace(pendulum_mass=2.3)
    machines = [STICKY, heavy] * 4
    mixed = evaluate(push, STICKY, SMALL, starts=starts, machines=machines)
    for k, machine in enumerate((STICKY, heavy)):
        alone = evaluate(push, machine, SMALL, starts=starts[k::2])
        assert alone.walking.any()
        for name in ("walking", "speeds", "cots"):
            np.testing.assert_array_equal(getattr(mixed, name)[k::2], getattr(alone, name), name)
    with pytest.raises(ValueError, match="machines: 7 for 8 starts"):
        evaluate(push, STICKY, SMALL, starts=starts, machines=machines[:7])
    with pytest.raises(ValueError, match=r"machines\[7\]: n_legs = 9: must be 5"):
        evaluate(push, STICKY, starts=starts, machines=[*machines[:7], STICKY.replace(n_legs=9)])


def test_a_policy_of_zeros_rests_and_its_evaluation_is_plain_json():
    result = evaluate(rest, THESIS_PHYSICAL, dataclasses.replace(SMALL, starts=8, duration=15.0))
    assert result.walking_share == 0.0
    assert math.isnan(result.cot)
    assert math.isnan(result.speed)
    assert result.steps_per_period == 0
    assert (~result.fallen).mean() > 0.5
    assert result.objective <= 0.0
    values = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert values["cot"] is None
    assert set(values) == {field.name for field in dataclasses.fields(Evaluation)}


def test_figures_are_ratios_of_sums_over_the_whole_steps_of_the_window():
    by = Protocol(starts=4, duration=16.0, window=4.0, alive=2.0)
    policy = learned_policy(load_policy("evolution").act)
    result = evaluate(policy, protocol=by)
    assert result.walking.all()
    walks = Rollout(Conditions(), policy, draw_starts(BUILDABLE, by.starts, by.seed), 1600, by.seed)
    window = [interval.info for interval in walks][1200:]
    weight, times, least = BUILDABLE.weight, [], np.inf
    for i in range(by.starts):
        landed = [k for k, info in enumerate(window) if info["steps"][i] > 0]
        first, last = landed[0], landed[-1]
        begin, end = (0.01 * k + window[k]["touchdown_time"][i] for k in (first, last))
        energies = [info["electrical_positive"][i] + info["idle"][i] for info in window]
        distance = (len(landed) - 1) * BUILDABLE.step_length
        assert result.speeds[i] == pytest.approx(distance / (end - begin), rel=1e-4)
        energy = result.cots[i] * weight * distance
        assert sum(energies[first + 1 : last]) < energy < sum(energies[first : last + 1])
        times.append(end - begin)
        least = min(least, *(info["min_normal_force"][i] for info in window))
    assert result.ledger.time == pytest.approx(sum(times), rel=1e-12)
    assert result.speed == result.ledger.distance / result.ledger.time
    assert result.cot == pytest.approx(result.ledger.cost_of_transport(BUILDABLE), rel=1e-12)
    assert result.ledger.residual == pytest.approx(0.0, abs=1e-9)
    assert result.min_normal_force == least
    assert result.min_normal_force_over_weight == least / weight
    more = evaluate(policy, BUILDABLE.replace(idle_power=BUILDABLE.idle_power + 2.0), by)
    assert more.speed == result.speed
    assert more.cot - result.cot == pytest.approx(2.0 / (weight * result.speed))


def test_cost_of_transport_uses_the_weights_of_the_drawn_machines():
    exact = evaluate(push, STICKY, SMALL)
    point = STICKY.pendulum_mass
    same = evaluate(push, STICKY, SMALL, ranges={"pendulum_mass": (point, point)})
    assert same.cot == pytest.approx(exact.cot, rel=1e-12)
    heavier = STICKY.replace(pendulum_mass=2.3)
    starts = draw_starts(STICKY, SMALL.starts, SMALL.seed)
    one = evaluate(push, heavier, SMALL, starts=starts)
    drawn = evaluate(push, STICKY, SMALL, starts=starts, ranges={"pendulum_mass": (2.3, 2.3)})
    assert drawn.cot == pytest.approx(one.cot, rel=1e-9)
    assert drawn.objective == pytest.approx(one.objective, rel=1e-9)
    np.testing.assert_allclose(drawn.cots, one.cots, rtol=1e-9)


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
    assert not (result.fallen & result.walking).any()
    mean = (reward - 7.0 * fallen.sum()) / SMALL.starts
    assert result.objective == pytest.approx(mean / SMALL.window, rel=1e-12)


def test_walking_backward_does_not_count_as_walking():
    protocol = dataclasses.replace(WHOLE, starts=2)
    result = evaluate(rest, STICKY, protocol, starts=rolling(3.0, -3.0))
    assert not result.fallen.any()
    assert result.outcomes == ("walks", "stops")
    np.testing.assert_array_equal(result.walking, [True, False])


def test_a_walk_that_came_to_rest_before_the_end_does_not_count():
    whole = Protocol(starts=1, seed=0, duration=8.0, window=8.0, alive=8.0)
    assert evaluate(rest, STICKY, whole, starts=rolling(3.0)).walking_share == 1.0
    result = evaluate(rest, STICKY, dataclasses.replace(whole, alive=1.0), starts=rolling(3.0))
    assert result.walking_share == 0.0
    assert result.failures == {"stops": 1}


def test_a_walk_counts_where_the_ground_bears_its_friction_demand_and_no_less():
    """The same motion on other grounds: what it needs is measured, whether or not it counts."""
    needs = evaluate(rest, STICKY, WHOLE, starts=rolling(2.0))
    assert needs.outcomes == ("walks",)
    stance, impulse = needs.friction_demand, needs.impulse_friction_demand
    assert 0 < min(stance, impulse) < max(stance, impulse)
    violation = "slips" if stance > impulse else "slips_at_touchdown"
    for factor, outcome in ((1.001, "walks"), (0.99, violation)):
        ground = THESIS_PHYSICAL.replace(friction=factor * max(stance, impulse))
        result = evaluate(rest, ground, WHOLE, starts=rolling(2.0))
        assert result.outcomes == (outcome,)
        assert result.friction_demand == stance
        assert result.min_normal_force == needs.min_normal_force
        assert result.walking_share == (outcome == "walks")
        assert math.isnan(result.cot) == (outcome != "walks")


def test_a_pendulum_that_sweeps_the_floor_does_not_count_unless_there_is_no_floor():
    for length, outcome in ((0.17, "touches"), (0.19, "walks"), (0.14, "walks")):
        machine = STICKY.replace(pendulum_length=length, pendulum_mass=0.2)
        result = evaluate(rest, machine, WHOLE, starts=rolling(3.0, theta=0.0))
        assert result.outcomes == (outcome,), length
        assert (result.min_clearance < 0) == (length > 0.15)


def test_outcomes_add_up_to_the_starts():
    result = evaluate(push, THESIS_PHYSICAL, SMALL)
    assert len(result.outcomes) == SMALL.starts
    assert set(result.outcomes) <= set(OUTCOMES)
    assert sum(result.failures.values()) + result.walking.sum() == SMALL.starts
    assert {"slips", "stops"} <= set(result.failures)
    np.testing.assert_array_equal(result.walking, [v == "walks" for v in result.outcomes])
    np.testing.assert_array_equal(result.fallen, [v == "falls" for v in result.outcomes])


@pytest.mark.parametrize("period", range(1, 7))
def test_a_walk_whose_steps_repeat_after_some_has_that_period(period):
    cycle = np.random.default_rng(period).uniform(0.3, 0.6, period)
    scatter = 1e-3 * np.random.default_rng(9).normal(size=8 * period)
    assert steps_per_period(np.cumsum(np.tile(cycle, 8) + scatter)) == period


def test_a_walk_that_never_repeats_has_period_zero():
    assert steps_per_period(np.cumsum(np.random.default_rng(0).uniform(0.3, 0.6, 60))) == 0
    assert steps_per_period([]) == 0


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        ({"seed": -1}, ValueError, "seed = -1"),
        ({"duration": 10.0, "window": 20.0}, ValueError, "grow in this order"),
    ],
)
def test_invalid_protocols_are_refused_by_name(settings, error, message):
    with pytest.raises(error, match=message):
        Protocol(**settings)


BRIEF = Protocol(starts=2, duration=0.2, window=0.1, alive=0.05)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"policy": 3}, TypeError, "policy = 3: must be a function"),
        ({"policy": lambda s, o: np.full(len(s), np.nan)}, ValueError, "one number in"),
        ({"starts": np.zeros(4)}, ValueError, "starts: must be finite, of shape"),
        (
            {"protocol": BRIEF, "control_period": 0.1},
            ValueError,
            "alive = 0.05 s: must be at least",
        ),
    ],
)
def test_invalid_arguments_of_an_evaluation_are_refused_by_name(arguments, error, message):
    with pytest.raises(error, match=message):
        evaluate(**({"policy": rest, "protocol": SMALL} | arguments))


def test_the_interquartile_mean_is_that_of_the_middle_half():
    assert interquartile_mean([-100, 1, 2, 3, 4, 5, 6, 100]) == pytest.approx(3.5)
    # of five values the middle half holds 2.5: the middle one, and three quarters of its neighbours
    assert interquartile_mean([0, 1, 2, 4, 50]) == pytest.approx((0.75 * 1 + 2 + 0.75 * 4) / 2.5)
    assert interquartile_mean([7.0]) == 7.0
    for values in ([], [1.0, np.nan], np.zeros((2, 2, 2))):
        with pytest.raises(ValueError, match="finite numbers"):
            interquartile_mean(values)


def test_the_bootstrap_interval_covers_the_true_mean_about_as_often_as_it_says():
    rng = np.random.default_rng(1)
    covered = 0
    for trial in range(200):
        low, high = bootstrap_interval(rng.normal(3.0, 1.0, size=20), resamples=400, seed=trial)
        covered += low <= 3.0 <= high
    assert 0.87 <= covered / 200 <= 0.99
    values = [0.1, 0.12, 0.11, 0.2]
    assert bootstrap_interval(values) == bootstrap_interval(values)
    # two tasks far apart: resampling across them would scatter the mean by their distance
    values = np.column_stack([np.zeros(8), np.full(8, 100.0)])
    assert bootstrap_interval(values) == (50.0, 50.0)


def leaning(states, seen):
    """Lean further forward, the faster it should go; both are steady voltages that roll on."""
    return np.where(seen[:, 6] > 0.5, 0.7, 0.6)


def share(walks, *outcomes):
    return sum(walks.failures.get(outcome, 0) for outcome in outcomes) / COMMANDED.starts


def test_a_policy_is_evaluated_at_each_command_by_itself_and_sees_it():
    commands = []

    def looking(states, seen):
        commands.append(set(seen[:, 6].tolist()))
        assert seen.shape[1] == 8
        return leaning(states, seen)

    slow, fast = evaluate_commanded(looking, (0.35, 0.6), protocol=COMMANDED)
    assert {len(each) for each in commands} == {1}
    assert np.allclose(sorted(set.union(*commands)), [-0.5, 0.75])
    assert share(slow, "falls", "stops") < 0.7
    assert share(fast, "falls", "stops") < 0.8
    assert slow.speed < fast.speed
    assert slow.cot > 0.5


def test_the_clone_of_an_optimal_gaits_law_walks_at_no_other_speed_than_its_own():
    act = load_policy("imitation").act
    short = Protocol(starts=8, duration=16.0, window=8.0, alive=4.0)
    blind = learned_policy(lambda seen: act(seen[:, :6]))
    at_home = evaluate(learned_policy(act), protocol=short)
    slow, fast = evaluate_commanded(blind, (0.35, 0.6), protocol=short, control_period=0.01)
    assert at_home.walking_share == slow.walking_share == fast.walking_share == 1.0
    assert slow.speed == fast.speed == pytest.approx(0.62, abs=0.02)
    assert slow.cot == fast.cot == pytest.approx(at_home.cot, rel=0.01)


def test_rewards_are_those_of_the_task_with_a_command():
    (usual,) = evaluate_commanded(rest, [0.5], protocol=COMMANDED)
    (same,) = evaluate_commanded(rest, [0.5], protocol=COMMANDED, task=TASK)
    (slow,) = evaluate_commanded(leaning, [0.5], protocol=COMMANDED)
    (plain,) = evaluate_commanded(leaning, [0.5], protocol=COMMANDED, task=Task())
    assert usual.objective == same.objective
    assert slow.objective > plain.objective


@pytest.mark.parametrize("commands", [(), (0.5, -0.1), (3.0,), ((0.5,),)])
def test_speeds_that_cannot_be_commanded_are_refused(commands):
    with pytest.raises(ValueError, match=r"commands|speed"):
        evaluate_commanded(rest, commands, protocol=COMMANDED)


def test_a_speed_is_commanded_only_where_it_is_observed():
    walks = Rollout(Conditions(BUILDABLE), rest, draw_starts(BUILDABLE, 2, 0), 5)
    with pytest.raises(ValueError, match="none is commanded"):
        walks.command(0.5)
    with pytest.raises(ValueError, match="speed"):
        Rollout(Conditions(BUILDABLE), rest, draw_starts(BUILDABLE, 2, 0), 5, command=0.5)


def test_a_policy_is_evaluated_at_round_speeds_of_the_range_that_it_was_trained_for():
    assert commands_within(0.51, 0.63) == [0.52, 0.54, 0.56, 0.58, 0.6, 0.62]
    assert commands_within(0.4, 0.44) == [0.4, 0.42, 0.44]
    assert commands_within(0.501, 0.502) == [0.501, 0.502]
