"""CleanRL's PPO and SAC for continuous actions train on the environments, through shims."""

from __future__ import annotations

import importlib.util
import math
import re
from pathlib import Path

import pytest

from agents.evaluate import COMMANDS
from tests.peers.running import printed

pytestmark = pytest.mark.peers
EVALUATED = Path(__file__).with_name("cleanrl_evaluated.py")

#: Two episodes of 500 steps, and some updates.
SHORT = {
    "ppo_continuous_action": ["--total-timesteps", "1200", "--num-steps", "300"],
    "sac_continuous_action": ["--total-timesteps", "1050", "--learning-starts", "950"],
}


@pytest.mark.parametrize("script", SHORT)
def test_a_script_trains_reports_the_returns_of_whole_episodes_and_is_evaluated(script, tmp_path):
    if importlib.util.find_spec("cleanrl") is None:
        pytest.skip("CleanRL's scripts are not installed: make peers installs them")
    command = ["-W", "ignore", str(EVALUATED), script, *SHORT[script]]
    output = printed([*command, "--env-id", "RimlessWheelSpeed-v0", "--cuda", "False"], tmp_path)
    returns = re.findall(r"global_step=(\d+), episodic_return=\[?([-\d.e]+)", output)
    assert len(returns) >= 2
    assert all(math.isfinite(float(total)) for _, total in returns)
    assert "SPS:" in output  # printed after an update
    assert list(tmp_path.glob("runs/*/events.*"))
    evaluated = re.findall(r"commanded ([\d.]+) m/s: (\d+) % walk", output)
    assert [float(command) for command, _ in evaluated] == list(COMMANDS)
