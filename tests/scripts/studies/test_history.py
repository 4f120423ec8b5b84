"""A clone with a memory is taught what it sees when it walks."""

import dataclasses

import numpy as np

from agents.conditions import Conditions
from agents.imitation import Cloning
from agents.rollout import draw_starts
from rimless_gym import BUILDABLE
from rimless_gym.envs.layout import observe
from scripts.studies.history import FRAME, LAGS, Network, TeachingWithHistory, remembering

#: Two of these starts fall within the walk, at different times.
STARTS = draw_starts(BUILDABLE, 16, 3)


def constant(states, observations):
    return np.full(len(states), 0.3)


def teaching(**changes):
    config = Cloning(rounds=2, seconds=2.0, labels=64, gait_labels=32, gradient_steps=3)
    return TeachingWithHistory(constant, Conditions(), dataclasses.replace(config, **changes), 0)


def test_walks_have_the_history_that_the_network_saw():
    saw = []

    def policy(states, seen):
        saw.append(seen)
        return np.sin(np.arange(len(states)) + len(saw))

    walks = teaching().walks(policy, STARTS, (1,))
    ends = np.bincount(walks.which)
    assert ends.min() < ends.max() == 200
    np.testing.assert_array_equal(walks.observations, np.concatenate(saw))
    one = walks.observations[walks.which == np.argmax(ends)]
    own = np.column_stack([one[:, : FRAME - 1], walks.actions[walks.which == np.argmax(ends)]])
    for i, lag in enumerate(LAGS):
        past = one[:, FRAME * (i + 1) - 1 :][:, :FRAME]
        np.testing.assert_allclose(past[lag:], own[:-lag], rtol=1e-6)
        assert not past[:lag].any()


def test_a_clone_with_a_memory_learns_its_experts_voltage_and_is_kept(tmp_path):
    of = teaching(expert_starts=8, starts=8, gait_starts=2, gradient_steps=300, batch_size=64)
    policy = remembering(of, tmp_path / "clone.pt")
    seen = observe(BUILDABLE, STARTS)
    actions = policy(STARTS, seen)
    past = np.zeros((len(seen), FRAME * len(LAGS)), dtype=np.float32)
    untrained = Network().act(np.concatenate([seen, past], axis=1))
    assert np.abs(actions - 0.3).mean() < 0.1 < np.abs(untrained - 0.3).mean()
    again = remembering(dataclasses.replace(of, seed=1), tmp_path / "clone.pt")
    np.testing.assert_array_equal(again(STARTS, seen), actions)
