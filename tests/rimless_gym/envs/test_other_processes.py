"""Seeds and actions say everything: episodes are the same again, in another process too."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

import gymnasium as gym
import numpy as np

from tests.rimless_gym.envs.rows import ROUGH, make, swinging


def test_the_same_seed_and_actions_give_the_same_episode(env: gym.Env) -> None:
    def episode() -> list[np.ndarray]:
        rng = np.random.default_rng(0)
        seen = [env.reset(seed=3)[0]]
        for _ in range(200):
            observation, _, ended, _, _ = env.step(rng.uniform(-0.3, 0.3, 1).astype(np.float32))
            seen.append(observation)
            if ended:
                break
        return seen

    assert np.array_equal(episode(), episode())


def test_another_process_sees_the_same_episode() -> None:
    code = (
        "import gymnasium, numpy, rimless_gym;"
        "env = gymnasium.make('RimlessWheel-v0');"
        "seen = [env.reset(seed=4)[0]];"
        "seen += [env.step(numpy.full(1, 0.2, 'f4'))[0] for _ in range(50)];"
        "print(numpy.array(seen).tobytes().hex())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    env = gym.make("RimlessWheel-v0")
    seen = [env.reset(seed=4)[0]]
    seen += [env.step(np.full(1, 0.2, np.float32))[0] for _ in range(50)]
    assert done.stdout.strip() == np.array(seen).tobytes().hex()


def digest() -> str:
    envs, value = make(7, **ROUGH, max_episode_steps=50), hashlib.sha256()
    value.update(envs.reset(seed=3)[0].tobytes())
    for actions in swinging(7, 150):
        for part in envs.step(actions)[:4]:
            value.update(part.tobytes())
    return value.hexdigest()


def test_another_process_sees_the_same_episodes_in_rows() -> None:
    code = f"from {__name__} import digest; print(digest())"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stdout.strip() == digest()
