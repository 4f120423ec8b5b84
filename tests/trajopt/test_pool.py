"""Independent tasks side by side, and workers that end with their parent."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from trajopt.pool import KilledError, announce, cores, progress_bar, run

ROOT = Path(__file__).parents[2]

PARENT = """
import os, sys, time
sys.path.insert(0, sys.argv[1])
from trajopt.pool import run

def busy(task):
    if task == "solve":
        from trajopt import Mesh, solve
        from scripts.studies import textbook
        problem = textbook.cart_pole()
        print(os.getpid(), flush=True)
        while True:  # IPOPT, most of the time
            solve(problem, mesh=Mesh.uniform(problem, 200, 8), verify=False)
    print(os.getpid(), flush=True)
    time.sleep(600)

for _ in run(busy, ["solve", "sleep", "sleep"], workers=2):
    pass
"""


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended but is not waited for does not."""
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rsplit(")", 1)[1].split()[0] != "Z"


def within(seconds: float, condition: Callable[[], bool]) -> bool:
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize(
    "by", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT], ids=lambda each: each.name
)
def test_workers_end_with_their_parent_however_it_ends(by: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    command = [sys.executable, str(tmp_path / "parent.py"), str(ROOT)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as parent:
        assert parent.stdout is not None
        workers = [int(parent.stdout.readline()) for _ in range(2)]
        time.sleep(0.5)
        assert all(map(alive, workers))
        parent.send_signal(by)
        ended = within(5.0, lambda: parent.poll() is not None)
        gone = within(3.0, lambda: not any(map(alive, workers)))
        for pid in filter(alive, [parent.pid, *workers]):
            os.kill(pid, signal.SIGKILL)
    assert (ended, gone) == (True, True)


def square(number: int) -> tuple[int, int, int]:
    return number**2, os.getpid(), cores()


def test_every_task_comes_with_its_result_and_workers_share_the_cores() -> None:
    results = dict(run(square, range(5), workers=2, progress="squares"))
    assert {task: result[0] for task, result in results.items()} == {n: n**2 for n in range(5)}
    assert os.getpid() not in {pid for _, pid, _ in results.values()}
    assert {share for _, _, share in results.values()} == {max(1, cores() // 2)}


class Terminal(io.StringIO):
    """A terminal that keeps what is printed."""

    def isatty(self) -> bool:
        return True


def shown(title: str) -> str:
    """What of a bar and an announcement appears on a terminal."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stderr", terminal := Terminal())
        announce("it takes long")
        with progress_bar(title, total=2):
            pass
    return terminal.getvalue()


def test_progress_appears_on_a_terminal_but_not_of_tasks_side_by_side() -> None:
    assert "it takes long" in shown("gaits")
    assert "gaits" in shown("gaits")
    assert progress_bar("gaits").disable  # stderr is no terminal
    assert [text for _, text in run(shown, ["a", "b"], workers=2)] == ["", ""]


def test_the_time_of_a_bar_passes_while_a_task_takes_long() -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stderr", terminal := Terminal())
        patch.setattr("trajopt.pool.TICK", 0.01)
        with progress_bar("gaits", total=2):
            for _ in range(1000):
                if terminal.getvalue().count("gaits") > 3:
                    return
                time.sleep(0.01)
    pytest.fail("the bar stands still")


def test_one_worker_works_here_and_in_order() -> None:
    drawn: list[int] = []

    def tasks() -> Iterator[int]:
        for number in range(3):
            drawn.append(number)
            yield number

    for task, (_, pid, _) in run(square, tasks(), workers=1):
        assert (pid, drawn) == (os.getpid(), list(range(task + 1)))


def killed(number: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def refused(number: int) -> None:
    if number:
        raise ValueError(f"{number} is too many")
    time.sleep(600)


def test_a_killed_worker_or_a_failing_task_ends_the_others() -> None:
    with pytest.raises(KilledError, match="memory"):
        list(run(killed, range(3), workers=2))
    with pytest.raises(ValueError, match="1 is too many"):
        list(run(refused, range(3), workers=2))


def short_or_long(number: int) -> int:
    time.sleep(600 if number else 0)
    return number


def test_an_exception_where_results_are_used_abandons_the_work() -> None:
    def disk_full() -> None:
        for _ in run(short_or_long, range(3), workers=2):
            raise OSError("disk full")

    begin = time.monotonic()
    with pytest.raises(OSError, match="disk full"):
        disk_full()
    assert time.monotonic() - begin < 60
