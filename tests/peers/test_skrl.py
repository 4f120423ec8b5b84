"""skrl trains with PPO in our rows, wrapped as its documentation describes."""

from __future__ import annotations

import gymnasium as gym
import pytest

pytestmark = pytest.mark.peers
pytest.importorskip("skrl")

import torch  # noqa: E402
from skrl.agents.torch.ppo import PPO, PPO_CFG  # noqa: E402
from skrl.envs.wrappers.torch import wrap_env  # noqa: E402
from skrl.memories.torch import RandomMemory  # noqa: E402
from skrl.models.torch import DeterministicMixin, GaussianMixin, Model  # noqa: E402
from skrl.trainers.torch import SequentialTrainer  # noqa: E402
from skrl.utils import set_seed  # noqa: E402


class Policy(GaussianMixin, Model):
    def __init__(self, observation_space, action_space):
        Model.__init__(
            self, observation_space=observation_space, action_space=action_space, device="cpu"
        )
        GaussianMixin.__init__(self)
        self.net = torch.nn.Sequential(
            torch.nn.Linear(self.num_observations, 32),
            torch.nn.Tanh(),
            torch.nn.Linear(32, self.num_actions),
        )
        self.log_std = torch.nn.Parameter(torch.zeros(self.num_actions))

    def compute(self, inputs, role=""):
        return self.net(inputs["observations"]), {"log_std": self.log_std}


class Value(DeterministicMixin, Model):
    def __init__(self, observation_space, action_space):
        Model.__init__(
            self, observation_space=observation_space, action_space=action_space, device="cpu"
        )
        DeterministicMixin.__init__(self)
        self.net = torch.nn.Linear(self.num_observations, 1)

    def compute(self, inputs, role=""):
        return self.net(inputs["observations"]), {}


def test_a_few_updates_of_ppo_change_the_policy_and_see_every_row(tmp_path):
    set_seed(1)
    env = wrap_env(gym.make_vec("RimlessWheel-v0", num_envs=4))
    assert env.num_envs == 4
    assert env.observation_space.shape == (6,)
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
    models = {"policy": Policy(**spaces), "value": Value(**spaces)}
    before = models["policy"].net[0].weight.detach().clone()
    memory = RandomMemory(memory_size=32, num_envs=4, device="cpu")
    cfg = PPO_CFG(rollouts=32, learning_epochs=2, mini_batches=2)
    cfg.experiment.directory = str(tmp_path)
    cfg.experiment.write_interval = cfg.experiment.checkpoint_interval = 0
    agent = PPO(models=models, memory=memory, device="cpu", cfg=cfg, **spaces)
    settings = {"timesteps": 96, "headless": True, "close_environment_at_exit": False}
    SequentialTrainer(env=env, agents=agent, cfg=settings).train()
    after = models["policy"].net[0].weight.detach()
    assert torch.isfinite(after).all()
    assert not torch.equal(after, before)
    rewards = memory.get_tensor_by_name("rewards")
    assert rewards.shape[:2] == (32, 4)
    assert len(rewards[:, :, 0].sum(0).unique()) == 4
    env.close()
