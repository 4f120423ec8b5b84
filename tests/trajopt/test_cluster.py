"""Tasks on real local Dask and Ray clusters: the same results, whichever process is killed."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.evaluate import Protocol
from agents.learner import BEST
from agents.training import train
from agents.training_config import TrainingConfig
from rimless_gym import BUILDABLE
from rimless_gym.checks import MissingExtraError
from scripts.studies.fronts.solving import Place, RandomStarts, attempts
from scripts.studies.learning.command import SeedTask, completed
from scripts.studies.learning.trials import SeedResult, StudyRow, Trained
from tests.trajopt.ocp.test_multi_start import AROUND, FAMILY
from tests.trajopt.test_pool import alive, within
from trajopt import multi_start, pool
from trajopt.cluster import connected
from trajopt.store import DIGEST, HEADER, Store, jsonable

ROOT = Path(__file__).parents[2]

BRIEF = Protocol(starts=4, seed=1, duration=1.0, window=0.5, alive=0.5)

#: Whose command lines start the clusters.
ENGINES = ("dask", "ray")

DRIVER = """
import sys, time
from functools import partial
from pathlib import Path
from tests.trajopt.test_cluster import noted
from trajopt import pool
from trajopt.cluster import connected
from trajopt.store import Store

folder = Path(sys.argv[2])
with connected(sys.argv[1]), Store(folder / "store", {"seed": 1}) as store:
    tasks = [n for n in range(4) if str(n) not in store]
    print(len(tasks), flush=True)
    for task, result in pool.run(partial(noted, folder), tasks):
        store.save(str(task), result)
        print(task, flush=True)
"""


def free_port() -> int:
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        port: int = listening.getsockname()[1]
        return port


@contextmanager
def commands(*lines: str, **environment: str) -> Iterator[None]:
    """Command lines of Dask or Ray run meanwhile."""
    folder, paths = Path(sys.executable).parent, os.pathsep.join([str(ROOT), *sys.path])
    running = []
    try:
        for line in lines:
            program, *arguments = line.split()
            running.append(
                subprocess.Popen(
                    [folder / program, *arguments],
                    env=os.environ | {"PYTHONPATH": paths} | environment,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,
                )
            )
        yield
    finally:
        for each in running[::-1]:
            os.killpg(each.pid, signal.SIGTERM)
        for each in running:
            with suppress(subprocess.TimeoutExpired):
                each.wait(20)
            with suppress(ProcessLookupError):
                os.killpg(each.pid, signal.SIGKILL)


@contextmanager
def dask(*options: str, **environment: str) -> Iterator[str]:
    """A Dask cluster of two workers; its address."""
    pytest.importorskip("distributed", reason="needs the extra cluster")
    port = free_port()
    yes = "--no-dashboard"
    worker = f"dask worker tcp://127.0.0.1:{port} --nworkers 2 --nthreads 1 {yes}"
    scheduler = f"dask scheduler --host 127.0.0.1 --port {port} {yes}"
    with commands(scheduler, " ".join([worker, *options]), **environment):
        yield f"dask://127.0.0.1:{port}"


@contextmanager
def ray(**environment: str) -> Iterator[str]:
    """A Ray cluster of two workers; its address."""
    pytest.importorskip("ray", reason="needs the extra cluster")
    port, inner = free_port(), free_port()
    head = f"ray start --head --block --num-cpus 2 --port {inner} --ray-client-server-port {port}"
    head += " --include-dashboard=false --disable-usage-stats --object-store-memory 100000000"
    with commands(head, **environment):
        place = f"ray://127.0.0.1:{port}"
        assert within(180, partial(answers, place))
        yield place


def answers(place: str) -> bool:
    """Whether Ray can be connected to: long after its port is open, where the computer is busy."""
    import ray

    with suppress(Exception):  # of many kinds
        ray.init(place, log_to_driver=False)
        ray.shutdown()
        return True
    return False


@pytest.fixture(scope="module", params=ENGINES)
def address(request: pytest.FixtureRequest) -> Iterator[str]:
    with {"dask": dask, "ray": ray}[request.param]() as place:
        yield place


def noted(folder: Path, number: int) -> int:
    """A task that notes that it has begun; it takes long if it is not among the first two."""
    with (folder / f"began{number}").open("a") as file:
        file.write(f"{os.getpid()}\n")
    time.sleep(0.1 if number < 2 or (folder / "quick").exists() else 600)
    return number**2


def begun(folder: Path, number: int) -> list[int]:
    """The processes in which a task has begun."""
    file = folder / f"began{number}"
    return [int(line) for line in file.read_text().split()] if file.exists() else []


def killed_once(mark: Path, function: Callable[[Any], Any], task: Any) -> Any:
    """Call a function; the first time that any task does, its process is killed meanwhile."""
    with suppress(FileExistsError):
        mark.touch(exist_ok=False)
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGKILL)).start()
    return function(task)


class Brief(Trained):
    """A training with brief evaluations; its process is killed meanwhile if a file wants it."""

    def run(self, seed: int, folder: Path, others: Any, by: Protocol) -> SeedResult:
        with suppress(FileNotFoundError):
            (folder.parent / "kill").unlink()
            threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGKILL)).start()
        some: dict[str, Any] = {"timesteps": 4000, "hyperparameters": {"n_steps": 64}}
        trained = train(TrainingConfig("ppo", seed=seed, protocol=by, **some), folder)
        return SeedResult(self.evaluate(folder, by), trained.timesteps, 0.0)


def weights(policy: Path) -> dict[str, bytes]:
    """What a policy's file has besides its record, which has how long the training took."""
    with np.load(policy) as file:
        return {n: file[n].tobytes() for n in file.files if n not in (HEADER, DIGEST)}


@pytest.mark.slow
def test_a_worker_killed_in_a_front_costs_only_its_task(address: str, tmp_path: Path) -> None:
    tasks = [RandomStarts(Place(0, speed, 1), ((-1, 0, 2),)) for speed in (0.5, 0.55, 0.6)]
    here = [jsonable(attempts(BUILDABLE, task)) for task in tasks]
    work = partial(killed_once, tmp_path / "killed", partial(attempts, BUILDABLE))
    with connected(address):
        there = {task: jsonable(made) for task, made in pool.run(work, tasks)}
    assert (tmp_path / "killed").exists()
    assert [there[task] for task in tasks] == here  # to the last digit


@pytest.mark.slow
def test_a_worker_killed_in_a_study_costs_only_its_seed(address: str, tmp_path: Path) -> None:
    row, policies = StudyRow("ppo", "ppo", "learned", Brief("ppo")), []
    tasks = [SeedTask(row, seed) for seed in range(2)]
    for name, cluster in (("here", nullcontext()), ("there", connected(address))):
        with Store(tmp_path / name) as store, cluster:
            if name == "there":
                (store.folder / "kill").touch()
            assert completed(store, tasks, BRIEF, 1) == {}
            assert not (store.folder / "kill").exists()
            policies.append([weights(store.folder / task.key / BEST) for task in tasks])
    assert policies[0] == policies[1]


@pytest.mark.slow
def test_a_stopped_command_ends_its_tasks_and_goes_on(address: str, tmp_path: Path) -> None:
    (tmp_path / "driver.py").write_text(DRIVER)
    command = [sys.executable, str(tmp_path / "driver.py"), address, str(tmp_path)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    quiet: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    two, three = (partial(begun, tmp_path, number) for number in (2, 3))
    for times, by in enumerate([signal.SIGINT, signal.SIGKILL], 1):
        with subprocess.Popen(command, env=environment, **quiet) as driver:
            assert within(90, lambda: min(len(two()), len(three())) >= times)  # noqa: B023
            driver.send_signal(by)
            # after a kill Ray waits for half a minute
            assert within(60, lambda: not any(map(alive, [*two(), *three()])))
            assert within(10, lambda: driver.poll() is not None)
    (tmp_path / "quick").touch()
    again = subprocess.run(command, env=environment, check=True, **quiet)
    assert sorted(again.stdout.split()) == ["2", "2", "3"]  # two were left
    assert [len(begun(tmp_path, number)) for number in range(4)] == [1, 1, 3, 3]


@pytest.mark.slow
def test_errors_and_searches_are_as_in_local_processes(address: str) -> None:
    def refused(number: int) -> None:
        if number:
            raise ValueError(f"{number} is too many")
        time.sleep(600)

    with connected(address):
        with pytest.raises(ValueError, match="1 is too many"):
            list(pool.run(refused, range(3)))
        there = multi_start(AROUND, FAMILY, 4)
        with pytest.raises(pool.KilledError, match="4 times"):
            list(pool.run(lambda _: os.kill(os.getpid(), signal.SIGKILL), range(1)))
    for one, other in zip(multi_start(AROUND, FAMILY, 4).outcomes, there.outcomes, strict=True):
        assert (one.index, one.cost, one.failure) == (other.index, other.cost, other.failure)
        assert np.array_equal(one.phases[0].states, other.phases[0].states)


@pytest.mark.slow
@pytest.mark.parametrize("cluster", [dask, ray])
def test_workers_of_other_sources_are_refused_before_they_have_work(
    cluster: Callable[..., Any], tmp_path: Path
) -> None:
    for package in ("rimless_gym", "trajopt", "agents"):
        shutil.copytree(ROOT / package, tmp_path / package)
    with (tmp_path / "rimless_gym" / "equations.py").open("a") as file:
        file.write("# another comment\n")
    others = os.pathsep.join([str(tmp_path), *sys.path])
    with cluster(PYTHONPATH=others) as place:
        refused = pytest.raises(ConnectionRefusedError, match="sources of rimless_gym")
        with refused, connected(place):
            pass


@pytest.mark.slow
def test_a_cluster_that_dies_is_an_error_and_so_are_threads() -> None:
    threads = pytest.raises(ConnectionRefusedError, match="--nthreads 1")
    with dask("--nthreads", "2") as place, threads, connected(place):
        pass

    def killed(stack: ExitStack) -> None:
        with connected(stack.enter_context(dask())):
            for _ in pool.run(time.sleep, [0.1, 600.0, 600.0]):
                stack.close()

    with ExitStack() as stack, pytest.raises(ConnectionError, match="has ended"):
        killed(stack)
    with pytest.raises(ConnectionError, match="no Dask scheduler answers"), connected(place):
        pass


@pytest.mark.parametrize("place", ["dask://here:8786", "ray://here:10001", "auto"])
def test_an_extra_that_is_missing_is_named(place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("dask", "distributed", "ray"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=r"rimless-gym\[cluster\]"), connected(place):
        pass


@pytest.mark.parametrize("place", ["", "8786", "tcp://here:8786", "dask://", "automatic"])
def test_what_is_no_address_is_refused(place: str) -> None:
    with pytest.raises(ValueError, match="dask://HOST:PORT"), connected(place):
        pass
