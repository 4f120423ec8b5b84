"""Check that the fast tests notice faults: each mutant changes one line and must fail a test.

Runs in a copy of the last commit, so the checkout stays as it is. Every mutant names the tests
that should notice it; `--all` runs the whole fast suite on those that survive. Half an hour.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

from tqdm import tqdm
from tyro.conf import arg

ROOT = Path(__file__).resolve().parents[2]


class Mutant(NamedTuple):
    """One changed line."""

    file: str  # relative to the root
    old: str  # text that occurs once in it
    new: str  # text in its place
    tests: tuple[str, ...]  # files or folders of tests that should notice it


EQUATIONS, HYBRID = "rimless_gym/equations.py", "rimless_gym/hybrid.py"
TASK, ACCOUNTING = "rimless_gym/envs/task.py", "rimless_gym/kernel/accounting.py"
EVALUATE, VERIFY = "agents/evaluate.py", "trajopt/gaits/verify.py"

MODEL_TESTS = ("equations", "energy", "contact", "against_mujoco")
MODEL = tuple(f"tests/rimless_gym/test_{name}.py" for name in MODEL_TESTS)
KERNEL = ("tests/rimless_gym/kernel", "tests/rimless_gym/test_contact.py")
FOLDER, ENVS = "rimless_gym/envs", ("tests/rimless_gym/envs",)
REWARDS = ("tests/rimless_gym/envs/test_rewards.py", "tests/rimless_gym/envs/test_speed.py")
EVALUATION = ("tests/agents/test_evaluate.py", "tests/agents/test_rollout.py")
TRAINING = ("tests/agents/test_training.py", "tests/agents/sb3")
GAITS = ("tests/trajopt/gaits/test_verify.py", "tests/trajopt/gaits/test_solution.py")
RULES = ("tests/rimless_gym/test_rules.py",)

MUTANTS = (
    # Signs and factors of the physics
    Mutant(EQUATIONS, "return -p.L1 * cos(phi), p", "return p.L1 * cos(phi), p", MODEL),
    Mutant(EQUATIONS, "return dtheta + p.d1 * dphi", "return dtheta - p.d1 * dphi", MODEL),
    Mutant(EQUATIONS, "(u * duration - p.K * turn)", "(u * duration + p.K * turn)", MODEL),
    Mutant(EQUATIONS, "p.Cd * abs(dphi) * dphi", "p.Cd * dphi * dphi", MODEL),
    Mutant(EQUATIONS, "hub - c * dphi**2 - pendulum", "hub + c * dphi**2 - pendulum", MODEL),
    Mutant(EQUATIONS, "return phi - p.alpha, theta", "return phi + p.alpha, theta", MODEL),
    Mutant(EQUATIONS, "abs(fx) / fy if fy > 0.0", "fx / fy if fy > 0.0", MODEL),
    # Guards and resets
    Mutant(EQUATIONS, "return max(leading, -trailing)", "return max(leading, trailing)", KERNEL),
    Mutant(EQUATIONS, "p.b if direction > 0 else p.a)", "p.a if direction > 0 else p.b)", KERNEL),
    Mutant(HYBRID, "if leading > -trailing:", "if leading < -trailing:", KERNEL),
    Mutant(HYBRID, "dphi_new**2 < REST_ENERGY", "dphi_new**2 > REST_ENERGY", KERNEL),
    Mutant(HYBRID, "0.0, dtheta_rest, max(direction, 0)", "0.0, dtheta_rest, 0", KERNEL),
    # The ledger
    Mutant(ACCOUNTING, "lane, before - after)", "lane, after - before)", KERNEL),
    Mutant(ACCOUNTING, "ROW.touchdowns, lane, 1.0", "ROW.touchdowns, lane, 2.0", KERNEL),
    Mutant(ACCOUNTING, "- shift * descent(turn, p)", "+ shift * descent(turn, p)", KERNEL),
    # Rewards
    Mutant(
        TASK, "task.distance_weight * interval.rewarded_travel", "interval.rewarded_travel", REWARDS
    ),
    Mutant(TASK, "return 0.0 - slips * (", "return 0.0 + slips * (", REWARDS),
    Mutant(TASK, "task.fall_penalty + idle)", "task.fall_penalty)", REWARDS),
    Mutant(f"{FOLDER}/task.py", "travel = min(distance, allowance)", "travel = distance", ENVS),
    Mutant(f"{FOLDER}/task.py", "_positive + interval.idle)", "_positive)", ENVS),
    # Disturbances, starts and seeds of the environments
    Mutant(f"{FOLDER}/interval.py", "_change, i] += memory", "_change, i] -= memory", ENVS),
    Mutant(f"{FOLDER}/disturbances.py", "(phi - p.a), -1", "(phi - p.a), 1", ENVS),
    Mutant(f"{FOLDER}/disturbances.py", "held[(now + length", "held[(now + 1 + length", ENVS),
    Mutant(f"{FOLDER}/starts.py", "if kind < bounds[0]:", "if kind > bounds[0]:", ENVS),
    Mutant(f"{FOLDER}/vector_env.py", "[first + i for i", "[first for i", ENVS),
    # Rules and the evaluation protocol
    Mutant("rimless_gym/rules.py", "min_normal_force > 0.0", "min_normal_force > -1.0", RULES),
    Mutant("rimless_gym/rules.py", "demand > friction *", "demand > 2.0 * friction *", RULES),
    Mutant(EVALUATE, "seed: int = 20150501", "seed: int = 20150502", EVALUATION),
    Mutant(EVALUATE, "starts: int = 128", "starts: int = 64", EVALUATION),
    Mutant(EVALUATE, "late_steps > 0", "late_steps >= 0", EVALUATION),
    Mutant(EVALUATE, "np.arange(1, n + 1) - n / 4", "np.arange(1, n + 1) - n / 8", EVALUATION),
    Mutant(
        "agents/gaps.py",
        "FRONT_STEPS = (1, 2, 3)",
        "FRONT_STEPS = (1, 2)",
        ("tests/agents/test_gaps.py",),
    ),
    # Training
    Mutant("agents/reward_weight.py", "SHARE_EXPONENT = 4", "SHARE_EXPONENT = 1", TRAINING),
    Mutant("agents/training.py", "    seed: int = 0\n", "    seed: int = 1\n", TRAINING),
    Mutant("agents/sb3/hyperparameters.py", "max(remaining, 0.0)", "max(remaining, 0.5)", TRAINING),
    # Optimal control and files
    Mutant(VERIFY, "STATE_TOLERANCE = 1e-6", "STATE_TOLERANCE = 1e6", GAITS),
    Mutant(VERIFY, "AUDIT_TOLERANCE = 1e-6", "AUDIT_TOLERANCE = 1e6", GAITS),
    Mutant("trajopt/store.py", "!= digest(arrays):", "== None:", ("tests/trajopt/test_store.py",)),
)


def mutants(
    *, only: str = "", all_: Annotated[bool, arg(name="all", help_behavior_hint="")] = False
) -> int:
    """Check that the fast tests notice faults; the exit status is 1 if a mutant survives.

    Args:
        only: mutants of files whose path contains this.
        all_: run the whole fast suite on those that survive their own tests.
    """
    chosen = [each for each in MUTANTS if only in each.file]
    survivors = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        archive = subprocess.run(
            ["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True
        )
        subprocess.run(["tar", "-x"], cwd=copy, input=archive.stdout, check=True)
        for mutant in tqdm(chosen, desc="mutants"):
            if not caught(copy, mutant, mutant.tests) and not (
                all_ and caught(copy, mutant, ("tests",))
            ):
                survivors.append(mutant)
                tqdm.write(f"SURVIVES: {mutant.file}: {mutant.old!r} -> {mutant.new!r}")
    print(f"{len(chosen) - len(survivors)} of {len(chosen)} mutants are caught")
    return 1 if survivors else 0


def caught(copy: Path, mutant: Mutant, tests: Sequence[str]) -> bool:
    """Whether tests fail in a copy of the project with a mutant.

    Raises:
        ValueError: the mutant's old text does not occur once in its file.
    """
    path = copy / mutant.file
    original = path.read_text()
    if original.count(mutant.old) != 1:
        raise ValueError(f"{mutant.file}: {mutant.old!r} occurs {original.count(mutant.old)} times")
    path.write_text(original.replace(mutant.old, mutant.new))
    try:
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
        environment = {"PYTHONPATH": str(copy), "PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
        done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, check=False)
        return done.returncode == 1
    finally:
        path.write_text(original)
