"""The tests can be run as on other processors, and the report names those that fail."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from pathlib import Path

import pytest

from scripts.studies.processors import command
from scripts.studies.processors.imitated import PROCESSORS

ROOT = Path(__file__).parents[3]


@pytest.fixture
def missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """SkylakeX needs instructions that no machine has."""
    changed = [
        dataclasses.replace(p, needs=("magic",)) if p.name == "SkylakeX" else p for p in PROCESSORS
    ]
    monkeypatch.setattr(command, "PROCESSORS", tuple(changed))


def which(names: str, code: str) -> int:
    return command.main([*names.split(), "--pytest", f"--co -q -p no:cacheprovider {code}"])


@pytest.mark.slow
def test_every_chosen_processor_is_run_or_reported_as_skipped(
    missing: None, capfd: pytest.CaptureFixture[str]
) -> None:
    assert which("Prescott SkylakeX", "tests/trajopt/ocp/test_ties.py") == 0
    summary = capfd.readouterr().out.split("\n\n")[-1].splitlines()
    assert [line.split()[:2] for line in summary] == [
        ["SkylakeX", "skipped:"],
        ["Prescott", "passed"],
    ]
    assert "no magic" in summary[0]


def test_a_failure_is_reported_by_name_and_by_the_exit_status(
    capfd: pytest.CaptureFixture[str],
) -> None:
    assert which("x86-64-v2", "tests/nothing.py") == 1
    assert "x86-64-v2  FAILED" in capfd.readouterr().out


@pytest.mark.parametrize("name", ["x86-64-v2", "x86-64-v3"])
def test_numba_compiles_for_the_chosen_processor_only(name: str, tmp_path: Path) -> None:
    (processor,) = (p for p in PROCESSORS if p.name == name)
    code = (
        "from numba.core.registry import cpu_target\n"
        "print(cpu_target.target_context.codegen().magic_tuple())"
    )
    environment = processor.environment | {"NUMBA_CACHE_DIR": str(tmp_path)}
    program = [sys.executable, "-c", code]
    done = subprocess.run(program, capture_output=True, text=True, check=True, env=environment)
    assert name in done.stdout
    assert "avx512" not in done.stdout


def test_unknown_processors_are_refused() -> None:
    with pytest.raises(SystemExit) as refusal:
        command.main(["Z80"])
    assert refusal.value.code == 2
