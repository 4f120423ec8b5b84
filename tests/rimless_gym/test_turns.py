"""Turns between processes: a turn ends with its process at the latest."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from rimless_gym.turns import Turn

HOLDS = """
import pathlib, sys, time
from rimless_gym.turns import Turn
turn = Turn()
with turn:
    turn.take(pathlib.Path(sys.argv[1]))
    print("mine", flush=True)
    time.sleep(float(sys.argv[2]))
print("over", flush=True)
"""


def holder(path: Path, seconds: float) -> subprocess.Popen[str]:
    """A process that takes a turn."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDS, str(path), str(seconds)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        text=True,
    )
    return process


def heard(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def test_one_process_at_a_time_holds_the_turn_and_a_killed_one_releases_it(tmp_path: Path) -> None:
    first, second = holder(tmp_path / "turn", 60), None
    try:
        assert heard(first) == "mine"
        second = holder(tmp_path / "turn", 0)
        try:
            second.wait(1.0)
            raise AssertionError("the second did not wait")
        except subprocess.TimeoutExpired:
            pass
        first.kill()
        assert heard(second) == "mine"
        assert heard(second) == "over"
    finally:
        for process in (first, second):
            if process is not None:
                process.kill()
                process.communicate()


def test_turns_can_be_nested_and_the_outermost_releases_the_lock(tmp_path: Path) -> None:
    turn = Turn()
    with turn:
        turn.take(tmp_path / "turn")
        with turn:
            turn.take(tmp_path / "turn")
        other = holder(tmp_path / "turn", 0)
        try:
            other.wait(1.0)
            raise AssertionError("the turn ended with the inner block")
        except subprocess.TimeoutExpired:
            pass
    assert heard(other) == "mine"
    other.communicate()


def test_without_a_lock_file_nobody_waits(tmp_path: Path) -> None:
    turn = Turn()
    with turn:
        turn.take(tmp_path / "missing" / "turn")
