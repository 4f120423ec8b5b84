"""Policies at commanded speeds."""

from __future__ import annotations

import numpy as np
import pytest

from agents import load_policy
from agents.commanded import commands_within, evaluate_commanded, walk_through
from agents.conditions import Conditions
from agents.evaluate import Protocol, evaluate
from agents.policies import learned_policy
from agents.rollout import Rollout, draw_starts
from rimless_gym import BUILDABLE, Task
from rimless_gym.envs.speed import TASK

BRIEF = Protocol(starts=16, duration=16.0, window=8.0, alive=4.0)


def standing(states, seen):
    return np.zeros(len(seen))


def leaning(states, seen):
    """Lean further forward, the faster it should go; both are steady voltages that roll on."""
    return np.where(seen[:, 6] > 0.5, 0.7, 0.6)


def share(walks, *outcomes):
    return sum(walks.failures.get(outcome, 0) for outcome in outcomes) / BRIEF.starts


def test_a_policy_that_stands_does_not_walk_at_any_speed():
    for walks in evaluate_commanded(standing, protocol=BRIEF):
        assert walks.walking_share == 0.0
        assert np.isnan(walks.cot)
        assert np.isnan(walks.speed)
        assert walks.failures == {"stops": BRIEF.starts}


def test_a_policy_is_evaluated_at_each_command_by_itself_and_sees_it():
    commands = []

    def looking(states, seen):
        commands.append(set(seen[:, 6].tolist()))
        assert seen.shape[1] == 8
        return leaning(states, seen)

    slow, fast = evaluate_commanded(looking, (0.35, 0.6), protocol=BRIEF)
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
    slow, fast = evaluate_commanded(blind, (0.35, 0.6), protocol=short)
    assert at_home.walking_share == slow.walking_share == fast.walking_share == 1.0
    assert slow.speed == fast.speed == pytest.approx(0.56, abs=0.02)
    assert slow.cot > 1.2 * at_home.cot  # it was made for a voltage that is held for 10 ms


def test_rewards_are_those_of_the_task_with_a_command():
    (usual,) = evaluate_commanded(standing, [0.5], protocol=BRIEF)
    (same,) = evaluate_commanded(standing, [0.5], protocol=BRIEF, task=TASK)
    (slow,) = evaluate_commanded(leaning, [0.5], protocol=BRIEF)
    (plain,) = evaluate_commanded(leaning, [0.5], protocol=BRIEF, task=Task())
    assert usual.objective == same.objective
    assert slow.objective > plain.objective


@pytest.mark.parametrize("commands", [(), (0.5, -0.1), (3.0,), ((0.5,),)])
def test_speeds_that_cannot_be_commanded_are_refused(commands):
    with pytest.raises(ValueError, match=r"commands|speed"):
        evaluate_commanded(standing, commands, protocol=BRIEF)


def test_a_walk_goes_on_while_the_command_changes():
    seen_commands = []

    def looking(states, seen):
        seen_commands.append(seen[0, 6])
        return leaning(states, seen)

    fast, slow = walk_through(looking, (0.6, 0.35), protocol=BRIEF, seconds=8.0)
    each = round(8.0 / 0.04)
    assert np.allclose(seen_commands, [0.75] * (2 * each + 1) + [-0.5] * (each - 1))
    assert (fast.command, slow.command) == (0.6, 0.35)
    assert fast.speed > slow.speed > 0.5
    assert fast.walking_share >= slow.walking_share > 0.2
    assert 0.0 < fast.fallen_share <= slow.fallen_share < 0.8


def test_all_commands_have_figures_where_all_walks_fall():
    def toppling(states, seen):
        return np.where(np.arange(len(seen)) % 2, -1.0, 1.0) * np.sign(seen[:, 1] + 0.3)

    stretches = walk_through(toppling, (0.5, 0.6, 0.4), BUILDABLE, BRIEF, seconds=2.0)
    assert [stretch.command for stretch in stretches] == [0.5, 0.6, 0.4]
    assert [stretch.fallen_share for stretch in stretches] == [1.0] * 3
    assert all(np.isnan(stretch.cot) for stretch in stretches)


def test_a_speed_is_commanded_only_where_it_is_observed():
    walks = Rollout(Conditions(BUILDABLE), standing, draw_starts(BUILDABLE, 2, 0), 5)
    with pytest.raises(ValueError, match="none is commanded"):
        walks.command(0.5)
    with pytest.raises(ValueError, match="speed"):
        Rollout(Conditions(BUILDABLE), standing, draw_starts(BUILDABLE, 2, 0), 5, command=0.5)


def test_a_policy_is_evaluated_at_round_speeds_of_the_range_that_it_was_trained_for():
    assert commands_within(0.51, 0.63) == [0.52, 0.54, 0.56, 0.58, 0.6, 0.62]
    assert commands_within(0.4, 0.44) == [0.4, 0.42, 0.44]
    assert commands_within(0.501, 0.502) == [0.501, 0.502]
