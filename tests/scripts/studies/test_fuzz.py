"""Short fuzzes find nothing in our environments, and find what is wrong in broken ones."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rimless_gym import RimlessWheelVectorEnv
from scripts.studies.fuzzing import trial
from scripts.studies.fuzzing.campaign import Worker
from scripts.studies.fuzzing.tally import Tally
from scripts.studies.fuzzing.trial import Trial

ROOT = Path(__file__).parents[3]


def fuzz(*arguments: str) -> list[str]:
    return [sys.executable, str(ROOT / "scripts" / "fuzz.py"), *arguments]


@pytest.fixture(autouse=True)
def _compiled() -> None:
    trial.warm_up()


@pytest.fixture(scope="module")
def plain() -> int:
    """The seed of a trial without ranges and disturbances: only those are reintegrated."""
    trial.warm_up()
    tallies = ((seed, Trial(seed).run()) for seed in range(50))
    return next(seed for seed, tally in tallies if tally.reintegrated > 10)


@pytest.mark.parametrize("seeds", [range(5), range(100, 104)])
def test_a_short_fuzz_finds_nothing(seeds: range) -> None:
    tally = sum((Trial(seed).run() for seed in seeds), Tally())
    assert tally.cases == ()
    assert tally.steps > 20_000
    assert tally.reintegrated > 20
    assert tally.twinned > 400
    assert 0.0 < tally.residual < 1e-7
    assert 0.0 < tally.difference < 1e-8


def test_the_seed_determines_a_trial(plain: int) -> None:
    tally = Trial(plain).run()
    assert tally == Trial(plain).run()
    assert tally != Trial(plain + 1).run()


class Biased(RimlessWheelVectorEnv):
    """An environment that alters what its steps return."""

    def step(self, actions: Any) -> Any:
        seen = super().step(actions)
        self.alter(*seen)
        return seen

    def alter(self, observations: Any, rewards: Any, ends: Any, limits: Any, info: Any) -> None:
        raise NotImplementedError


class Overdrawn(Biased):
    def alter(self, observations: Any, rewards: Any, ends: Any, limits: Any, info: Any) -> None:
        info["electrical"] *= 1 + 1e-4


class Undefined(Biased):
    def alter(self, observations: Any, rewards: Any, ends: Any, limits: Any, info: Any) -> None:
        rewards[0] = np.nan


class Outside(Biased):
    def alter(self, observations: Any, rewards: Any, ends: Any, limits: Any, info: Any) -> None:
        observations[:, 1] *= 2.0


class Rounded(Biased):
    def alter(self, observations: Any, rewards: Any, ends: Any, limits: Any, info: Any) -> None:
        info["clearance"][:] = np.nextafter(info["clearance"], np.inf)


class Sunken(RimlessWheelVectorEnv):
    """An environment whose feet are below the ground."""

    @property
    def states(self) -> Any:
        states = super().states
        states[:, 0] += 1e-3
        return states


class Heavier(RimlessWheelVectorEnv):
    """An environment with stronger gravity, by a thousandth, than its parameters say."""

    def __init__(self, n: int, params: Any, **settings: Any) -> None:
        self.said = tuple(params if isinstance(params, list) else [params] * n)
        real = [machine.replace(gravity=machine.gravity * 1.001) for machine in self.said]
        super().__init__(n, real, **settings)

    @property
    def params(self) -> Any:
        return self.said


@pytest.mark.parametrize(
    ("kind", "trouble"),
    [
        (Overdrawn, "the ledger's residual"),
        (Undefined, "the reward is not finite"),
        (Outside, "outside its space"),
        (Rounded, r"clearance = .* differs from the single environment's"),
        (Sunken, "a foot is below the ground"),
        (Heavier, "from the reference"),
        (Heavier, "differs from the single environment's"),
    ],
)
def test_a_fuzz_finds_an_environment_that_is_wrong(
    plain: int, kind: type[RimlessWheelVectorEnv], trouble: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial, "MOST_CASES", 1000)
    cases = Trial(plain, kind).run().cases
    assert any(re.search(trouble, case.trouble) for case in cases)
    assert all(case.seed == plain for case in cases)
    assert json.loads(str(cases[0]).removeprefix("FAILURE "))["seed"] == plain


def test_a_fuzz_finds_a_step_that_takes_too_long(
    plain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trial, "SLOWEST_ROW", 0.0)
    monkeypatch.setattr(trial, "SLOWEST_CALL", 0.0)
    assert "a step took" in Trial(plain).run().cases[0].trouble


def test_a_process_that_crashes_is_reported_with_its_seed() -> None:
    before = set(multiprocessing.active_children())
    worker = Worker()
    worker.start(7)
    [process] = set(multiprocessing.active_children()) - before
    process.kill()
    [case] = worker.result().cases
    assert case.seed == 7
    assert "ended with exit code" in case.trouble
    assert not worker.alive
    worker.kill()


@pytest.mark.slow
def test_the_command_line_ends_with_a_summary() -> None:
    done = subprocess.run(
        fuzz("--seeds", "2", "--workers", "1"), capture_output=True, text=True, check=True
    )
    [line] = done.stdout.splitlines()
    assert "2 seeds" in line
    assert "0 failures" in line
    assert "2.00/2.00" in done.stderr


@pytest.mark.slow
def test_ctrl_c_prints_what_was_found_so_far() -> None:
    process = subprocess.Popen(
        fuzz("--minutes", "5", "--workers", "1"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    time.sleep(15)
    os.killpg(process.pid, signal.SIGINT)
    out, complaints = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "failures" in out.splitlines()[-1]
    assert "Traceback" not in complaints
