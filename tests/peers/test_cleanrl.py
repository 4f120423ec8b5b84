"""CleanRL's PPO and SAC for continuous actions train on the environments, through shims."""

from __future__ import annotations

import importlib.util
import math
import re
from pathlib import Path

import pytest

from agents.commanded import COMMANDS
from tests.peers.running import printed

pytestmark = pytest.mark.peers
JUDGED = Path(__file__).with_name("cleanrl_judged.py")

#: Two episodes of 500 steps, and some updates.
SHORT = {
    "ppo_continuous_action": ["--total-timesteps", "1200", "--num-steps", "300"],
    "sac_continuous_action": ["--total-timesteps", "1050", "--learning-starts", "950"],
}


@pytest.mark.parametrize("script", SHORT)
def test_a_script_trains_reports_the_returns_of_whole_episodes_and_is_judged(script, tmp_path):
    if importlib.util.find_spec("cleanrl") is None:
        pytest.skip("CleanRL's scripts are not installed: make peers installs them")
    command = ["-W", "ignore", str(JUDGED), script, *SHORT[script]]
    told = printed([*command, "--env-id", "RimlessWheelSpeed-v0", "--cuda", "False"], tmp_path)
    found = re.findall(r"global_step=(\d+), episodic_return=\[?([-\d.e]+)", told)
    assert len(found) >= 2
    assert all(math.isfinite(float(total)) for _, total in found)
    assert "SPS:" in told  # printed after an update
    assert list(tmp_path.glob("runs/*/events.*"))
    judged = re.findall(r"commanded ([\d.]+) m/s: (\d+) % walk", told)
    assert [float(command) for command, _ in judged] == list(COMMANDS)
