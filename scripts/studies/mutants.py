"""Check that the fast tests notice faults: each mutant changes one line and must fail a test.

Runs in a copy of the last commit, so the checkout stays as it is. Every mutant names the tests
that should notice it; `--all` runs the whole fast suite on those that survive. Half an hour.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[2]


class Mutant(NamedTuple):
    """One changed line.

    Attributes:
        file: relative to the root.
        old: text that occurs once in it.
        new: text in its place.
        tests: files or folders of tests that should notice it.
    """

    file: str
    old: str
    new: str
    tests: tuple[str, ...]


EQUATIONS, HYBRID = "rimless_gym/equations.py", "rimless_gym/hybrid.py"
FOLDER = "rimless_gym/envs"
MODEL = ("tests/rimless_gym/test_equations.py", "tests/rimless_gym/test_energy.py")
KERNEL = ("tests/rimless_gym/kernel",)
ENVS = ("tests/rimless_gym/envs",)
AGENTS = ("tests/agents",)

MUTANTS = (
    # Signs and factors of the physics.
    Mutant(EQUATIONS, "return -p.L1 * cos(phi), p", "return p.L1 * cos(phi), p", MODEL),
    Mutant(EQUATIONS, "return dtheta + p.d1 * dphi", "return dtheta - p.d1 * dphi", MODEL),
    Mutant(EQUATIONS, "(u * duration - p.K * turn)", "(u * duration + p.K * turn)", MODEL),
    Mutant(EQUATIONS, "return p.Cd * abs(dphi) * dphi", "return p.Cd * dphi * dphi", MODEL),
    Mutant(EQUATIONS, "p.F0 * p.F0 + (p.c * torque) ** 2", "p.F0 * p.F0 + p.c * torque", MODEL),
    Mutant(EQUATIONS, "hub - c * dphi**2 - pendulum", "hub + c * dphi**2 - pendulum", MODEL),
    Mutant(EQUATIONS, "return max(leading, -trailing)", "return max(leading, trailing)", KERNEL),
    Mutant(EQUATIONS, "p.b if direction > 0 else p.a)", "p.a if direction > 0 else p.b)", KERNEL),
    Mutant(
        EQUATIONS, "return phi - p.alpha, theta, dphi_new", "return phi, theta, dphi_new", MODEL
    ),
    Mutant(EQUATIONS, "return -pull - fy", "return pull - fy", KERNEL),
    # Guards and resets.
    Mutant(HYBRID, "return leading <= 0.0 <= trailing", "return leading <= trailing", KERNEL),
    Mutant(
        HYBRID,
        "SINGLE, phi_new, dphi_new, dtheta_new, direction",
        "SINGLE, phi_new, dphi_new, dtheta_new, 1",
        KERNEL,
    ),
    Mutant(HYBRID, "if leading > -trailing:", "if leading < -trailing:", KERNEL),
    Mutant(HYBRID, "dphi_new**2 < REST_ENERGY", "dphi_new**2 > REST_ENERGY", KERNEL),
    # Rewards, accounting, disturbances, starts and seeds of the environments.
    Mutant(f"{FOLDER}/task.py", "travel = min(distance, allowance)", "travel = distance", ENVS),
    Mutant(f"{FOLDER}/task.py", "_positive + interval.idle)", "_positive)", ENVS),
    Mutant(f"{FOLDER}/task.py", "interval.failed * (task", "0.5 * interval.failed * (task", ENVS),
    Mutant(f"{FOLDER}/interval.py", "_change, i] += memory", "_change, i] -= memory", ENVS),
    Mutant(f"{FOLDER}/disturbances.py", "phi, shift = p.b, -1", "phi, shift = p.b, 1", ENVS),
    Mutant(f"{FOLDER}/disturbances.py", "held[(now + length", "held[(now + 1 + length", ENVS),
    Mutant(f"{FOLDER}/starts.py", "if kind < bounds[0]:", "if kind > bounds[0]:", ENVS),
    Mutant(f"{FOLDER}/vector_env.py", "[first + i for i", "[first for i", ENVS),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; 1 if a mutant survives."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", help="mutants of files whose path contains this")
    parser.add_argument("--all", action="store_true", help="the whole fast suite for survivors")
    options = parser.parse_args(arguments)
    mutants = [each for each in MUTANTS if not options.only or options.only in each.file]
    survivors = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        archive = subprocess.run(
            ["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True
        )
        subprocess.run(["tar", "-x"], cwd=copy, input=archive.stdout, check=True)
        for mutant in tqdm(mutants, desc="mutants"):
            if not caught(copy, mutant, mutant.tests) and not (
                options.all and caught(copy, mutant, ("tests",))
            ):
                survivors.append(mutant)
                tqdm.write(f"SURVIVES: {mutant.file}: {mutant.old!r} -> {mutant.new!r}")
    print(f"{len(mutants) - len(survivors)} of {len(mutants)} mutants are caught")
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


if __name__ == "__main__":
    sys.exit(main())
