"""rl-zoo3 trains with our hyperparameter files, in its own vector of environments and in ours."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

pytestmark = pytest.mark.peers
pytest.importorskip("rl_zoo3")

ROOT = Path(__file__).parents[2]
ARGUMENTS = ["--gym-packages", "rimless_gym", "--env", "RimlessWheel-v0", "--device", "cpu"]
STEPS = {"ppo": 1, "sac": 5200}  # a rollout of PPO; a little past SAC's learning_starts

#: rl-zoo3's command line, in which ExperimentManager's default class of vectors is ours.
NATIVE = """
from rl_zoo3.exp_manager import ExperimentManager
from rl_zoo3.train import train
from agents import Sb3VecEnv
ExperimentManager.default_vec_env_cls = Sb3VecEnv
train()
"""


@pytest.mark.parametrize("algo", ["ppo", "sac"])
@pytest.mark.parametrize("program", [["-m", "rl_zoo3.train"], ["-c", NATIVE]], ids=["own", "ours"])
def test_it_trains_with_our_hyperparameters(tmp_path, program, algo):
    settings = ROOT / "agents" / "hyperparams" / f"{algo}.yml"
    command = [sys.executable, *program, *ARGUMENTS, "--algo", algo, "--conf-file", settings]
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [*command, "-n", str(STEPS[algo]), "-f", tmp_path, "--eval-freq", "-1"],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    out = tmp_path / algo / "RimlessWheel-v0_1"
    assert (out / "RimlessWheel-v0.zip").is_file()
    entry = yaml.safe_load(settings.read_text())["RimlessWheel-v0"]
    assert f"Using {entry['n_envs']} environments" in done.stdout
    episodes = [
        line for file in out.glob("*.monitor.csv") for line in file.read_text().splitlines()[2:]
    ]
    assert len(list(out.glob("*.monitor.csv"))) == entry["n_envs"]
    assert episodes
