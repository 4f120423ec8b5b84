"""Seed and actions determine an episode, in any process and with any threads."""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from rimless_gym.envs.interval import step_rows
from rimless_gym.envs.layout import NUMBER_NAMES
from tests.rimless_gym.envs.rows import ID, ROUGH, make, swinging

SETTINGS = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
STEPS = swinging(3, 300)
NUMBERS = [name for name in NUMBER_NAMES if name != "failure"]


def printed(function: str, **environment: str) -> str:
    """What a function of this file returns in another process."""
    code = f"import {__name__} as here; print(here.{function}())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env=SETTINGS | environment,
    )
    return done.stdout.strip()


def digest() -> str:
    envs, value = make(7, **ROUGH, max_episode_steps=50), hashlib.sha256()
    value.update(envs.reset(seed=3)[0].tobytes())
    for actions in swinging(7, 150):
        for part in envs.step(actions)[:4]:
            value.update(part.tobytes())
    return value.hexdigest()


def test_another_process_sees_the_same_episodes() -> None:
    here = digest()
    assert digest() == here
    assert printed("digest") == here


FORKS = """
import hashlib, os, numpy as np
from rimless_gym import RimlessWheelVectorEnv
n = 1024
envs = RimlessWheelVectorEnv(n, num_threads=2)
envs.reset(seed=0)
actions = np.zeros((n, 1), np.float32)
envs.step(actions)  # which starts the threads
child = os.fork()
seen = envs.step(actions)[0].tobytes()
envs.close()
if child:
    os.waitpid(child, 0)  # one line after the other
print(hashlib.sha256(seen).hexdigest(), flush=True)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_a_forked_child_keeps_stepping_with_its_own_threads() -> None:
    command = [sys.executable, "-c", FORKS]
    process = subprocess.Popen(
        command, env=SETTINGS, stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        out, _ = process.communicate(timeout=100)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise
    parent, child = out.splitlines()
    assert parent == child


def in_rows() -> str:
    envs = make(3)
    envs.reset(seed=5)
    out = []
    for actions in STEPS:
        _, rewards, terminated, _, info = envs.step(actions)
        running = (info["elapsed"] > 0.0) | terminated  # else it was reset
        out += [np.stack([rewards, *(info[name] for name in NUMBERS)])[:, running].T.tobytes()]
    return hashlib.sha256(b"".join(out)).hexdigest()


def alone() -> str:
    envs = [gym.make(ID) for _ in range(3)]
    for i, env in enumerate(envs):
        env.reset(seed=5 + i)
    out, ended = [], [False] * 3
    for actions in STEPS:
        for i, env in enumerate(envs):
            if ended[i]:
                env.reset()
                ended[i] = False
                continue
            _, reward, terminated, truncated, _ = env.step(actions[i])
            ended[i] = terminated or truncated
            measured = env.unwrapped.measurements
            out += [np.array([reward, *(measured[name] for name in NUMBERS)]).tobytes()]
    return hashlib.sha256(b"".join(out)).hexdigest()


def test_one_compiled_function_steps_one_row_and_many() -> None:
    """Two functions, compiled by different processes, have differed in the last bits."""
    for envs in (make(1), make(3), make(3, **ROUGH), gym.make(ID)):
        envs.reset(seed=0)
        envs.step(np.zeros(envs.action_space.shape, dtype=np.float32))
    assert len(step_rows.signatures) == 1


@pytest.mark.slow
def test_rows_equal_single_environments_whichever_process_compiled_them(tmp_path: Path) -> None:
    cache = {"NUMBA_CACHE_DIR": str(tmp_path)}
    assert printed("alone", **cache) == printed("in_rows", **cache)
