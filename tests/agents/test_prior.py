"""A law as prior: the potential in the reward, the starts, and what does not fit."""

import dataclasses

import gymnasium as gym
import numpy as np
import pytest

from agents.conditions import Conditions
from agents.learner import Training, learner_class
from agents.policy_files import CheckpointError, load_policy
from agents.prior import SHARE, PotentialShaping, Prior, ReferenceStarts, law_prior
from agents.rollout import draw_starts
from agents.sb3.feedforward import Feedforward
from agents.sb3.vec_env import Sb3VecEnv
from agents.sb3.wrappers import wrapped
from rimless_gym import BUILDABLE, THESIS_PHYSICAL, Task
from rimless_gym.envs.layout import observe
from rimless_gym.envs.task import TERM_NAMES
from rimless_gym.kernel.stepping import MODE
from tests.agents.runs import assert_same_policies, config, killed_after, run

N = 8
STATES = draw_starts(BUILDABLE, 16, 3)
PRIOR = Prior(
    *("made up", BUILDABLE, Task(), 0.01, STATES),
    potential=lambda seen: 0.1 * seen[:, 3] - 0.05 * seen[:, 2],
    fallen=-1.0,
)


def envs(**arguments):
    usual = {"max_episode_steps": 50, "autoreset_mode": "SameStep"}
    return gym.make_vec("RimlessWheel-v0", num_envs=N, **(usual | arguments))


@pytest.mark.parametrize("voltage", [0.0, 1.0])
def test_over_an_episode_the_reward_grows_by_the_change_of_the_potential(voltage):
    env = PotentialShaping(envs(max_episode_steps=200), PRIOR)
    seen, _ = env.reset(seed=1)
    first, gained, ended = PRIOR.at(seen), np.zeros(N), np.zeros(N, dtype=bool)
    falls = 0
    for _ in range(200):
        seen, rewards, fell, timed_out, info = env.step(np.full((N, 1), voltage))
        gained += np.where(ended, 0.0, rewards - sum(info[name] for name in TERM_NAMES))
        for i in np.flatnonzero((fell | timed_out) & ~ended):
            last = PRIOR.fallen if fell[i] else PRIOR.at(info["final_obs"][i][None])[0]
            assert gained[i] == pytest.approx(last - first[i], abs=1e-6)
            falls += fell[i]
        ended |= fell | timed_out
    assert ended.all()
    assert (falls > 0) == (voltage > 0)


def test_sensor_noise_leaves_the_potential_as_it_is():
    prior = dataclasses.replace(PRIOR, potential=lambda seen: -np.abs(seen[:, 4]))
    env = PotentialShaping(envs(disturbances={"sensor_noise": {"pendulum_rate": 0.2}}), prior)
    env.reset(seed=1)
    for _ in range(20):
        before = prior.at(observe(BUILDABLE, env.native.states))
        _, rewards, _, _, info = env.step(np.full((N, 1), 0.3))
        gained = rewards - sum(info[name] for name in TERM_NAMES)
        after = prior.at(observe(BUILDABLE, env.native.states))
        np.testing.assert_allclose(gained, after - before, atol=1e-6)


def test_a_share_of_the_episodes_begins_in_the_priors_states():
    own = {tuple(row) for row in observe(BUILDABLE, STATES).tolist()}
    env = ReferenceStarts(envs(max_episode_steps=5), PRIOR)
    starts = [*env.reset(seed=2)[0]]
    for step in range(1, 201):
        seen = env.step(np.zeros((N, 1)))[0]
        starts += [*seen] if step % 5 == 0 else []
    begun = np.mean([tuple(row) in own for row in np.array(starts).tolist()])
    assert abs(begun - SHARE) < 0.1


def test_the_potential_is_evaluated_once_a_step_where_no_episode_begins():
    calls = []
    prior = dataclasses.replace(PRIOR, potential=lambda seen: calls.append(1) or seen[:, 2] * 1.0)
    env = PotentialShaping(envs(), prior)
    env.reset(seed=1)
    for _ in range(20):
        env.step(np.zeros((N, 1)))
    assert len(calls) == 21


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"params": [BUILDABLE] * (N - 1) + [THESIS_PHYSICAL]},
            "machine has .*'gear_ratio': '[^']* .not [^']*'.*; make another",
        ),
        ({"task": {"distance_weight": 0.3}}, "task = .*, not .*; make another"),
        ({"control_period": 0.02}, "period = 0.01, not 0.02"),
        ({"autoreset_mode": "NextStep"}, "SAME_STEP"),
    ],
)
def test_another_environment_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        PotentialShaping(envs(**arguments), PRIOR)
    with pytest.raises(ValueError, match=message):
        ReferenceStarts(envs(**arguments), PRIOR)


def test_what_is_no_prior_is_refused():
    broken = dataclasses.replace(PRIOR, potential=lambda seen: np.full(len(seen), np.nan))
    env = PotentialShaping(envs(), broken)
    env.reset(seed=1)
    with pytest.raises(ValueError, match=r"8 observations .*not finite"):
        env.step(np.zeros((N, 1)))
    with pytest.raises(ValueError, match="prior = 'imitation': must be 'law'"):
        config(prior="imitation").training()
    with pytest.raises(ValueError, match="evolution takes none"):
        config("evolution", prior=PRIOR).training()
    with pytest.raises(ValueError, match="task = "):
        config(prior=PRIOR, task={"distance_weight": 0.3}).training()
    with pytest.raises(ValueError, match=r"states: must be \(M, .*not \(4,\)"):
        dataclasses.replace(PRIOR, states=STATES[0][:4])
    with pytest.raises(ValueError, match="states: 1 of 16 are not finite; leave them out"):
        dataclasses.replace(PRIOR, states=np.where(np.arange(16)[:, None] == 3, np.nan, STATES))
    flying = STATES.copy()
    flying[0, MODE] = 7
    with pytest.raises(ValueError, match=r"modes \[7.0\] must be among {0: 'single_stance', 1"):
        dataclasses.replace(PRIOR, states=flying)
    with pytest.raises(ValueError, match="a clone needs no prior"):
        config(prior="law", init="imitation").training()
    with pytest.raises(ValueError, match="leave out speeds"):
        config(prior="law", speeds=(0.5, 0.6)).training()


def test_what_is_cheap_to_check_is_refused_before_the_law_walks(tmp_path, monkeypatch):
    monkeypatch.setattr("agents.training.law_prior", lambda *_: pytest.fail("the law walks"))
    with pytest.raises(CheckpointError, match="check the path"):
        run(tmp_path / "a", prior="law", init="none.zip")
    run(tmp_path / "b", timesteps=0)
    with pytest.raises(ValueError, match="holds results of"):
        run(tmp_path / "b", timesteps=0, seed=1, prior="law")


def learner_of(algo="ppo", **changes):
    kind = learner_class(algo)
    settings = kind.settings("prior", {"n_envs": 2, **changes})
    return kind(Training(algo, "scratch", 0, Conditions(), Task(), settings, PRIOR))


def test_a_file_of_ppo_commands_voltages_where_the_network_commanded_deviations():
    learner = learner_of()
    seen = observe(BUILDABLE, draw_starts(BUILDABLE, 64, 4))
    parts = learner.parts()
    kept = type(learner).load(
        dataclasses.replace(parts, record=parts.record | {"timesteps": 0}), Conditions(), Task()
    )
    assert np.std(learner.act(seen)) > 0.05
    np.testing.assert_allclose(kept(seen), learner.act(seen), atol=7e-3)


def test_a_file_of_sac_has_the_scale_of_its_deviations(tmp_path):
    last = load_policy(run(tmp_path, "sac", prior=PRIOR, timesteps=64).last)
    seen = observe(BUILDABLE, draw_starts(BUILDABLE, 64, 4))
    back_emf = Feedforward(BUILDABLE, 0.3).voltages(np.zeros((64, 1)), seen)[:, 0]
    assert 0.0 < np.abs(last.act(seen) - back_emf).max() <= 0.3
    with pytest.raises(ValueError, match=r"actions are 0.3 times deviations .* training are volt"):
        run(tmp_path / "more", "sac", init=tmp_path / "last.zip", timesteps=64)


def test_what_does_not_go_with_deviations_is_refused(tmp_path):
    with pytest.raises(ValueError, match="PPO needs hidden layers of Tanh"):
        learner_of(policy_kwargs={"activation_fn": "ReLU"}).parts()
    with pytest.raises(ValueError, match=r"ent_coef = 0.1: noise needs SAC"):
        learner_of("sac", ent_coef=0.1)
    with pytest.raises(ValueError, match="n_steps = 3: with a prior it must be 1"):
        learner_of("sac", n_steps=3)
    normalised = {"stable_baselines3.common.vec_env.VecNormalize": {}}
    with pytest.raises(ValueError, match="VecNormalize': its statistics are not saved"):
        learner_of("sac", vec_env_wrapper=[normalised])


def test_sac_samples_rewards_with_the_weight_that_the_potential_has_now():
    """After a fall the potential is that of a fall, and at a time limit that of the state."""
    learner = learner_of("sac")
    buffer, envs = learner.model.replay_buffer, wrapped(learner.model.env, Sb3VecEnv).env
    assert isinstance(envs, ReferenceStarts)  # and no potential besides
    assert envs.env is envs.unwrapped
    seen = observe(BUILDABLE, draw_starts(BUILDABLE, 4, 5))
    before, after = seen[:2], seen[2:]
    late = {"TimeLimit.truncated": True}
    rewards = np.array([0.3, 0.4])
    buffer.add(before, after, np.zeros((2, 1)), rewards, np.ones(2), [{}, late])
    change = [PRIOR.fallen, PRIOR.at(after)[1]] - PRIOR.at(before)
    for weight in (1.0, 4.0):
        learner._shaping.weight = weight
        samples = buffer.sample(32)
        which = (samples.observations.numpy() == before[1]).all(axis=1).astype(int)
        wanted = rewards / weight + 40.0 * change
        np.testing.assert_allclose(samples.rewards[:, 0], wanted[which], rtol=1e-5)
        assert set(which) == {0, 1}


def test_the_policy_of_sac_with_a_prior_is_the_average_of_its_actor(tmp_path, monkeypatch):
    def weights_after(steps, averaged):
        monkeypatch.setattr("agents.sb3.sac.AVERAGED", averaged)
        out = tmp_path / f"{steps}_{averaged}"
        few = {"gradient_steps": 1, "batch_size": 32}
        trained = run(out, "sac", prior=PRIOR, timesteps=steps, hyperparameters=few)
        return load_policy(trained.last).parts.weights

    first, slow, quick = (weights_after(*each) for each in ((0, 1), (160, 10**9), (160, 1)))
    actor, critic = "actor.mu.weight", "critic.qf0.0.weight"
    moved = [np.abs(each[actor] - first[actor]).mean() for each in (slow, quick)]
    assert 0.2 < moved[0] / moved[1] < 0.8  # the mean of all actors, and the last one
    np.testing.assert_array_equal(quick[critic], slow[critic])
    assert not np.array_equal(quick[critic], first[critic])


@pytest.mark.parametrize("algo", ["ppo", pytest.param("sac", marks=pytest.mark.slow)])
def test_killed_a_training_with_a_prior_ends_with_the_same_policies(tmp_path, monkeypatch, algo):
    whole = run(tmp_path / "whole", algo, prior=PRIOR)
    killed_after(70, monkeypatch, lambda: run(tmp_path / "killed", algo, prior=PRIOR))
    assert_same_policies(whole, run(tmp_path / "killed", algo, prior=PRIOR))


def test_noise_and_the_weight_of_the_potential_change_on_the_way(tmp_path, monkeypatch):
    weights, step = [], PotentialShaping.step
    monkeypatch.setattr(
        PotentialShaping, "step", lambda self, a: weights.append(self.weight) or step(self, a)
    )
    annealed = {"first": 0.1, "last": 0.001, "begin": 0.3, "end": 0.7}
    potential = {"first": 8.0, "last": 2.0, "begin": 0.0, "end": 1.0}
    given = {"noise": annealed, "potential": potential}
    last = run(tmp_path, prior=PRIOR, hyperparameters=given).last
    assert load_policy(last).parts.weights["log_std"][0] == pytest.approx(np.log(0.001))
    assert weights[0] == 8.0
    assert 2.0 < weights[-1] < 4.0
    assert sorted(weights, reverse=True) == weights


@pytest.mark.slow
def test_the_laws_potential_rises_along_its_walks():
    prior = law_prior(Conditions(), Task())
    hanging, moving = draw_starts(BUILDABLE, 64, 9), prior.states[-64:]
    low, high = prior.at(observe(BUILDABLE, hanging)), prior.at(observe(BUILDABLE, moving))
    assert low.mean() < high.mean() - 0.3
    assert prior.fallen < low.min()
