"""An offline learner of TorchRL's learns to walk from a dataset of ours, and from nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from agents.conditions import Conditions
from agents.datasets import DatasetConfig, dataset_id, write
from agents.policy_files import BASELINES
from agents.rollout import episodes
from rimless_gym import BUILDABLE

pytestmark = pytest.mark.peers
pytest.importorskip("torchrl")
pytest.importorskip("minari")

import minari  # noqa: E402
import torch  # noqa: E402
from tensordict import TensorDict  # noqa: E402
from tensordict.nn import TensorDictModule  # noqa: E402
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer  # noqa: E402
from torchrl.modules import MLP  # noqa: E402
from torchrl.objectives import BCLoss  # noqa: E402

POLICY = "robust"
CONFIG = DatasetConfig(None, 100, 1000, 0.56)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The walks of a shipped policy."""
    made = tmp_path_factory.mktemp("data")
    write(made, POLICY, CONFIG)
    return made


def returns(policy) -> float:
    envs = Conditions(BUILDABLE).envs(20, max_episode_steps=2000)
    return float(np.mean([one.total for one in episodes(envs, policy)]))


def test_behaviour_cloning_on_a_dataset_walks_better_than_resting(folder, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    walked = list(minari.load_dataset(dataset_id(POLICY)).iterate_episodes())
    seen = np.concatenate([one.observations[:-1] for one in walked])
    done = np.concatenate([one.actions for one in walked])
    storage = LazyTensorStorage(len(seen))
    replay = TensorDictReplayBuffer(storage=storage, batch_size=256)
    columns = {"observation": torch.from_numpy(seen), "action": torch.from_numpy(done)}
    replay.extend(TensorDict(columns, batch_size=[len(seen)]))
    torch.manual_seed(0)
    torch.set_num_threads(1)
    net = MLP(in_features=6, out_features=1, num_cells=[128, 128], activation_class=torch.nn.Tanh)
    actor = TensorDictModule(net, in_keys=["observation"], out_keys=["action"])
    loss = BCLoss(actor, loss_function="l2")
    updates = 8000
    optimizer = torch.optim.Adam(loss.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 5e-3, total_steps=updates)
    for _ in range(updates):
        optimizer.zero_grad()
        loss(replay.sample())["loss_bc"].backward()
        optimizer.step()
        schedule.step()

    def policy(states, observations):
        with torch.no_grad():
            return net(torch.from_numpy(observations)).numpy()[:, 0]

    assert returns(policy) > returns(BASELINES["idle"](0)) + 1.0
