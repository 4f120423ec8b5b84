"""PPO of rejax trains on `rimless_gym.jax`, also with a law as prior; Brax steps it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

os.environ.setdefault("XLA_FLAGS", "--xla_disable_hlo_passes=fusion")  # compiles twice as fast
jax: Any = pytest.importorskip("jax")
from rimless_gym.jax import EnvParams, RejaxEnv, WheelEnv, brax_env  # noqa: E402

pytestmark = pytest.mark.peers
SMALL = {"num_envs": 8, "num_steps": 4, "num_minibatches": 2, "num_epochs": 1}


def test_ppo_of_rejax_trains() -> None:
    rejax = pytest.importorskip("rejax")
    env = RejaxEnv(control_period=0.02)
    settings = {"env_params": EnvParams(10), "total_timesteps": 64, "eval_freq": 32}
    learner = rejax.PPO.create(env=env, **settings, **SMALL)
    state, (lengths, returns) = jax.jit(learner.train)(jax.random.key(0))
    assert int(state.global_step) >= 64
    assert 1 <= int(lengths.min()) <= int(lengths.max()) <= 10
    assert np.isfinite(returns).all()


def test_the_wrappers_around_all_of_brax_s_learners_step_it() -> None:
    """Brax 0.14's PPO itself needs a JAX before 0.10, which had `jax.device_put_replicated`."""
    training = pytest.importorskip("brax.envs.wrappers.training")
    env = training.wrap(brax_env(WheelEnv()), episode_length=3)
    state = jax.jit(env.reset)(jax.random.split(jax.random.PRNGKey(0), 8))  # Brax wants old keys
    step, actions = jax.jit(env.step), np.full((8, 1), 0.2, np.float32)
    for _ in range(3):
        before, state = state, step(state, actions)
        assert np.isfinite(state.reward).all()
        assert state.obs.shape == (8, 6)
    assert not before.done.any()
    assert state.done.all()
    assert np.array_equal(state.obs, state.info["first_obs"])


def test_rejax_trains_with_a_prior_and_leaves_a_policy_that_acts(tmp_path: Path) -> None:
    pytest.importorskip("rejax")
    import torch

    from agents.learner import PRIOR
    from agents.policy_files import load_policy
    from agents.prior import LOWEST, Fitted, Prior
    from agents.sb3.feedforward import Feedforward
    from agents.sb3.learner import Ppo
    from rimless_gym import BUILDABLE
    from rimless_gym.envs.layout import observe
    from rimless_gym.envs.task import Task
    from scripts.studies.rejax_ppo import NAMES, ppo_of_rejax, prior_env, trained, with_actor

    states = np.array([[1.5, 0.3, 1.0, 9.0, 0, 0], [1.3, -2.0, 1.2, 10.0, 0, 0]])
    seen = observe(BUILDABLE, states)
    network = torch.nn.Sequential(torch.nn.Linear(6, 4), torch.nn.Tanh(), torch.nn.Linear(4, 1))
    potential = Fitted(network)
    prior = Prior("two states", BUILDABLE, Task(), 0.01, states, potential, LOWEST)
    few = {"n_timesteps": 64, "n_envs": 8, "n_steps": 4, "batch_size": 16, "n_epochs": 1}
    settings = Ppo.settings(PRIOR, few)
    of_jax = jax.vmap(prior_env(prior, settings).potential)(seen)
    assert np.asarray(of_jax) == pytest.approx(potential(seen), abs=1e-6)

    ppo, _ = ppo_of_rejax(prior, settings)
    state = ppo.init_state(jax.random.key(0))
    for file in trained(prior, 2, tmp_path, few):
        policy = load_policy(file)
        # without the units that pass the back-EMF on
        first, second = slice(None), slice(None, -1)
        own = {"action_net": (first, second), "mlp_extractor.policy_net.0": (second, first)}
        layers = []
        for name in NAMES:
            layer, part = name.rsplit(".", 1)
            rows, columns = own.get(layer, (second, second))
            weights = policy.parts.weights[name]
            layers.append((weights[rows, columns] if part == "weight" else weights[rows]).T)
        params = with_actor(state, np.full(1, -100.0), layers).actor_ts.params  # hardly any noise
        actions = ppo.actor.apply(params, seen, jax.random.key(0), method="act")
        volts = Feedforward(BUILDABLE, 1.0).voltages(np.asarray(actions), seen)[:, 0]
        assert policy.act(seen) == pytest.approx(volts, abs=7e-3)
