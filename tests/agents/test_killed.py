"""After a kill at a random moment, the same command goes on and ends with the same result."""

import functools
import json
import time
from multiprocessing import get_context

import numpy as np
import pytest

from agents import session
from agents.comparison import arena, compare, learned
from agents.comparison.compare import Comparison
from agents.comparison.study import Study
from agents.evaluate import Protocol, evaluate
from agents.imitation import Cloning
from agents.policy_files import load_policy
from agents.train import train
from agents.training import IMITATION
from tests.agents.runs import small

KILLS = {"training": 20, "comparison": 5}  # at least; one of a comparison takes a minute
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
    while kills < KILLS["training"]:
        out = tmp_path / f"after_{kills}"
        kills += killed_until_done(functools.partial(work, out), rng, longest)
        for mine, theirs in zip(weights(out), weights(tmp_path / "whole"), strict=True):
            np.testing.assert_array_equal(mine, theirs)


@pytest.mark.slow
def test_a_comparison_killed_at_random_moments_ends_with_the_same_table(tmp_path, monkeypatch):
    def brief(algo, init, *arguments, **settings):
        cloning = QUICK if init == IMITATION else None
        changed = {"settings": small(algo, init), "cloning": cloning}
        return train(algo, init, *arguments, **settings | changed)

    monkeypatch.setattr(arena, "evaluate", functools.partial(evaluate, protocol=BRIEF))
    monkeypatch.setattr(learned, "train", brief)
    monkeypatch.setattr(compare, "save_gif", lambda *args, **kw: None)
    monkeypatch.setattr(compare, "ANIMATED", 0.1)
    study = Study(
        timesteps=512,
        scratch_timesteps=512,
        evolution_timesteps=0,
        starts=0,
        further=(0.55,),
        front_steps=(1,),
    )

    def work(out):
        Comparison(study, out, progress=False).run()

    longest = 0.3 * duration(lambda: work(tmp_path / "whole"))
    rng, kills = np.random.default_rng(0), 0
    while kills < KILLS["comparison"]:
        out = tmp_path / f"after_{kills}"
        kills += killed_until_done(functools.partial(work, out), rng, longest)
        assert (out / "table.md").read_text() == (tmp_path / "whole" / "table.md").read_text()
        tables = [
            json.loads((folder / "results.json").read_text())["table"]
            for folder in (out, tmp_path / "whole")
        ]
        assert tables[0] == tables[1]
