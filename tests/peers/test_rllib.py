"""RLlib trains in the environment, registered as its documentation describes."""

from __future__ import annotations

import math

import gymnasium as gym
import pytest

import rimless_gym

pytestmark = pytest.mark.peers
pytest.importorskip("ray")


@pytest.fixture
def ray(monkeypatch):
    for name, value in (("RAY_AUTH_MODE", "disabled"), ("RAY_USAGE_STATS_ENABLED", "0")):
        monkeypatch.setenv(name, value)
    import ray

    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False, object_store_memory=2**27)
    yield ray
    ray.shutdown()


def test_an_iteration_of_ppo_learns_from_the_registered_environment(ray):
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.tune.registry import register_env

    register_env("RimlessWheel", lambda config: gym.make("RimlessWheel-v0", **config))
    config = (
        PPOConfig()
        .environment("RimlessWheel", env_config={"params": rimless_gym.PROTOTYPE})
        .env_runners(num_env_runners=0, num_envs_per_env_runner=2)
        .learners(num_learners=0)
        .training(train_batch_size=400, minibatch_size=100, num_epochs=1)
    )
    algorithm = config.build_algo()
    try:
        env = algorithm.env_runner.env
        assert env.single_observation_space.shape == (6,)
        result = algorithm.train()
    finally:
        algorithm.stop()
    assert result["num_env_steps_sampled_lifetime"] >= 400
    assert math.isfinite(result["learners"]["default_policy"]["total_loss"])
    assert math.isfinite(result["env_runners"]["episode_return_mean"])
