"""Workers end with their parent, whatever ends it and whatever they are doing."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from trajopt.processes import Crew, KilledError, crew, pool

ROOT = Path(__file__).parents[2]

PARENT = """
import os, sys, time
sys.path.insert(0, sys.argv[1])
from trajopt.processes import pool

def busy(solving):
    if solving:
        from trajopt import Mesh, solve
        from trajopt.ocp import textbook
        problem = textbook.cart_pole()
        while True:  # IPOPT, most of the time
            solve(problem, mesh=Mesh.uniform(problem, 200, 8), verify=False)
    time.sleep(600)

if __name__ == "__main__":
    with pool(2) as submit:
        workers = [submit(os.getpid) for _ in range(8)]
        print(*{w.result() for w in workers}, flush=True)
        running = [submit(busy, solving) for solving in (False, True)]
        time.sleep(1.0)
        print("busy", flush=True)
        for future in running:
            future.result()
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
@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGTERM], ids=["kill -9", "SIGTERM"])
def test_workers_are_gone_a_second_after_their_parent(by: signal.Signals, tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    command = [sys.executable, str(tmp_path / "parent.py"), str(ROOT)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        workers = [int(pid) for pid in parent.stdout.readline().split()]
        assert workers
        assert parent.stdout.readline() == "busy\n"
        assert all(map(alive, workers))
        parent.send_signal(by)
        parent.wait()
    gone = within(2.0, lambda: not any(map(alive, workers)))
    for pid in filter(alive, workers):
        os.kill(pid, signal.SIGKILL)
    assert gone


def test_an_exception_abandons_the_work_of_the_workers() -> None:
    begin = time.monotonic()

    def interrupted() -> None:
        with pool(1) as submit:
            submit(int).result()
            submit(time.sleep, 600)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - begin < 30
    assert not multiprocessing.active_children()


def test_work_is_finished_when_nothing_goes_wrong() -> None:
    with pool(1) as submit:
        results = [submit(pow, 2, n) for n in range(5)]
    assert [future.result() for future in results] == [1, 2, 4, 8, 16]


def killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def names_done(at_work: Crew) -> list[str]:
    """The names of all work in the order in which it is done."""
    done = []
    while at_work.busy:
        done += [name for name, _ in at_work.done()]
    return done


def test_work_whose_process_is_killed_is_named_and_what_is_done_comes_first() -> None:
    with crew(2) as at_work:
        at_work.begin("a", pow, 2, 3)
        assert list(at_work.done()) == [("a", 8)]
        at_work.begin("b", killed)
        at_work.begin("c", time.sleep, 0.0)
        assert (at_work.free, at_work.busy) == (0, ["b", "c"])
        with pytest.raises(KilledError, match=r"b: its process was killed.*memory"):
            names_done(at_work)
    assert not multiprocessing.active_children()
