"""CleanRL's PPO and SAC for continuous actions train on the environments, through shims."""

from __future__ import annotations

import importlib.util
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.peers
SHIMS = Path(__file__).with_name("cleanrl_shims.py")
ROOT = SHIMS.parents[2]

#: Two episodes of 500 steps, and some updates.
SHORT = {
    "ppo_continuous_action": ["--total-timesteps", "1200", "--num-steps", "300"],
    "sac_continuous_action": ["--total-timesteps", "1050", "--learning-starts", "950"],
}


@pytest.mark.parametrize("script", SHORT)
def test_a_script_trains_and_reports_the_returns_of_whole_episodes(script, tmp_path):
    if importlib.util.find_spec("cleanrl") is None:
        pytest.skip("CleanRL's scripts are not installed: make test-peers installs them")
    command = [sys.executable, "-W", "ignore", str(SHIMS), script, *SHORT[script]]
    command += ["--env-id", "RimlessWheelSpeed-v0", "--cuda", "False"]
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    found = re.findall(r"global_step=(\d+), episodic_return=\[?([-\d.e]+)", done.stdout)
    assert len(found) >= 2
    assert all(math.isfinite(float(total)) for _, total in found)
    assert "SPS:" in done.stdout  # printed after an update
    assert list(tmp_path.glob("runs/*/events.*"))
