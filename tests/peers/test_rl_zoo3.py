"""rl-zoo3 trains with our hyperparameter files, in its own vectors and ours, and shows policies."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

from agents import load_policy
from tests.peers.running import ROOT, printed

pytestmark = pytest.mark.peers
pytest.importorskip("rl_zoo3")

ARGUMENTS = ["--gym-packages", "rimless_gym", "--env", "RimlessWheel-v0", "--device", "cpu"]
EVALUATED = ROOT / "tests" / "peers" / "rl_zoo3_evaluated.py"
STEPS = {"ppo": 1, "sac": 5200}  # a rollout of PPO; a little past SAC's learning_starts

#: rl-zoo3's command line, in which ExperimentManager's default class of vectors is ours.
NATIVE = """
from rl_zoo3.exp_manager import ExperimentManager
from rl_zoo3.train import train
from agents import Sb3VecEnv
ExperimentManager.default_vec_env_cls = Sb3VecEnv
train()
"""


OWN, OURS = ["-m", "rl_zoo3.train"], ["-c", NATIVE]


def hyperparameters(algo: str) -> Path:
    return ROOT / "agents" / "hyperparams" / f"{algo}.yml"


def train(folder: Path, program: list[str], algo: str, *more: str) -> tuple[str, Path]:
    """Train for a moment; what was printed, and the folder that rl-zoo3 made."""
    command = [*program, *ARGUMENTS, "--algo", algo, "-f", str(folder), "--eval-freq", "-1"]
    command += ["--conf-file", str(hyperparameters(algo)), "-n", str(STEPS[algo]), *more]
    return printed(command, ROOT), folder / algo / "RimlessWheel-v0_1"


@pytest.mark.parametrize("algo", ["ppo", "sac"])
@pytest.mark.parametrize("program", [OWN, OURS], ids=["own", "ours"])
def test_it_trains_with_our_hyperparameters_what_we_can_evaluate(tmp_path, program, algo):
    output, out = train(tmp_path, program, algo)
    policy = out / "RimlessWheel-v0.zip"
    assert policy.is_file()
    entry = yaml.safe_load(hyperparameters(algo).read_text())["RimlessWheel-v0"]
    assert f"Using {entry['n_envs']} environments" in output
    episodes = [
        line for file in out.glob("*.monitor.csv") for line in file.read_text().splitlines()[2:]
    ]
    assert len(list(out.glob("*.monitor.csv"))) == entry["n_envs"]
    assert episodes
    assert "% walk" in printed([str(EVALUATED), algo, str(policy)], ROOT)


@pytest.mark.parametrize("program", [OWN, OURS], ids=["own", "ours"])
def test_its_command_line_chooses_the_machine_and_the_task(tmp_path, program):
    chosen = ["params:'PROTOTYPE'", "task:{'distance_weight': 0.8}"]
    _, out = train(tmp_path, program, "ppo", "--env-kwargs", *chosen)
    assert (out / "RimlessWheel-v0.zip").is_file()
    kept = (out / "RimlessWheel-v0" / "args.yml").read_text()
    assert "params: PROTOTYPE" in kept
    assert "distance_weight: 0.8" in kept


def test_it_shows_a_network_of_ours(tmp_path):
    folder = tmp_path / "ppo" / "RimlessWheel-v0_1"
    folder.mkdir(parents=True)
    load_policy("imitation").model.save(folder / "RimlessWheel-v0.zip")
    command = ["-m", "rl_zoo3.enjoy", *ARGUMENTS, "--algo", "ppo", "-f", str(tmp_path)]
    shown = printed([*command, "--no-render", "-n", "2000"], ROOT)
    (reward,) = re.findall(r"Mean reward: (\S+)", shown)
    assert float(reward) > 4.0
