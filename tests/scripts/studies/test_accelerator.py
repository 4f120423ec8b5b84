"""What `accelerator` measures of the simulator in JAX, on walks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from scripts.studies import accelerator
from scripts.studies.benchmark.ours import PRESET

jax: Any = pytest.importorskip("jax")
from rimless_gym.jax import WheelEnv  # noqa: E402

jax.config.update("jax_enable_x64", True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dtype", "state", "touchdown_time", "energy"),
    [("float32", 3e-5, 1e-6, 3e-6), ("float64", 1e-11, 1e-12, 1e-10)],
)
def test_walks_are_those_of_the_kernel(
    dtype: str, state: float, touchdown_time: float, energy: float, tmp_path: Path
) -> None:
    walks, env = accelerator.walks(tmp_path), WheelEnv(params=PRESET, dtype=dtype)
    (found,) = accelerator.measured(env, [walks], accelerator.DIFFERENT)
    assert found["disagree"] == 0
    assert found["state"] < state
    assert found["touchdown_time"] < touchdown_time
    assert found["electrical_positive"] < energy
