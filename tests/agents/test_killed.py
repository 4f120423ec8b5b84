"""After a kill at a random moment, the same command goes on and ends with the same result."""

import functools
import time
from multiprocessing import get_context

import numpy as np
import pytest

from agents import session
from agents.evaluate import Protocol
from agents.imitation import Cloning
from agents.policy_files import load_policy
from agents.train import train
from tests.agents.runs import small

KILLS = 20  # at least
BRIEF = Protocol(starts=8, seed=1, duration=2.0, window=1.0, alive=1.0)
QUICK = Cloning(rounds=2, expert_starts=10, seconds=0.5, gradient_steps=50, gait_labels=50)


@pytest.fixture(autouse=True)
def often(monkeypatch):
    """Save after each roll-out, so that kills often happen while a state is being written."""
    monkeypatch.setattr(session, "SAVE_INTERVAL", 0.0)


def duration(work):
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def killed_until_done(work, rng, longest):
    """How often `work` was killed before it came to its end."""
    kills = 0
    while True:
        process = get_context("fork").Process(target=work)
        process.start()
        process.join(rng.uniform(0, longest))
        if process.exitcode is not None:
            assert process.exitcode == 0
            return kills
        process.kill()
        process.join()
        kills += 1
        longest *= 1.1  # such that there is an end to it


def weights(folder):
    policies = [load_policy(folder / name).model.policy for name in ("best.zip", "last.zip")]
    return [p.detach().numpy() for policy in policies for p in policy.parameters()]


@pytest.mark.slow
@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_a_training_killed_at_random_moments_ends_with_the_same_policies(tmp_path, algo):
    steps = {"ppo": 1280, "sac": 320}[algo]

    def work(out):
        train(algo, out=out, timesteps=steps, settings=small(algo), protocol=BRIEF, progress=False)

    longest = 0.6 * duration(lambda: work(tmp_path / "whole"))
    rng, kills = np.random.default_rng(0), 0
    while kills < KILLS:
        out = tmp_path / f"after_{kills}"
        kills += killed_until_done(functools.partial(work, out), rng, longest)
        for mine, theirs in zip(weights(out), weights(tmp_path / "whole"), strict=True):
            np.testing.assert_array_equal(mine, theirs)
