"""Worker processes, which are all kept alive, and measure in turn."""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from scripts.studies.benchmarks.cases import Case
from scripts.studies.benchmarks.environments import OURS, UnavailableError, interpreter

COMMANDS = Path(__file__).resolve().parents[1]

#: Where the worker programs are, for an interpreter that runs in the folder of the commands.
MODULES = "benchmarks.workers."

#: Longest time (s) that a worker may take to answer: it may have to compile everything.
PATIENCE = 300.0


class WorkerError(RuntimeError):
    """A worker gave no answer, or reported an error."""


class Worker:
    """A running worker program.

    Args:
        case: what it measures.
        python: interpreter that runs it.
        folder: where it may keep files for the next run.

    Attributes:
        about: what it says of itself, see `scripts.studies.benchmarks.protocol`.

    Raises:
        WorkerError: it failed to start.
    """

    def __init__(self, case: Case, python: Path, folder: Path) -> None:
        settings = case.settings | {"one_core": case.one_core, "folder": str(folder.resolve())}
        module = MODULES + case.worker
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        if case.environment == OURS:
            environment["PYTHONPATH"] = str(COMMANDS.parents[1])  # this package
        self._complaints = tempfile.TemporaryFile("w+")  # noqa: SIM115  closed by close()
        self._process = subprocess.Popen(
            [str(python), "-m", module, json.dumps(settings)],
            cwd=COMMANDS,  # peers' interpreters find the module there
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._complaints,
            text=True,
            start_new_session=True,  # only this process gets Ctrl-C
        )
        try:
            self.about = self._hear()
        except BaseException:
            self.close()
            raise

    def measure(self, seconds: float) -> dict[str, Any]:
        """Let it measure once for about so many seconds, and return its answer.

        Raises:
            WorkerError: it gave no answer, or reported an error.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{seconds}\n")
            self._process.stdin.flush()
        except OSError as error:
            raise WorkerError(self._last_words()) from error
        return self._hear()

    @property
    def pid(self) -> int:
        """The id of its process."""
        return self._process.pid

    def close(self) -> None:
        """Kill it, and the processes that it started."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self._process.communicate()
        self._complaints.close()

    def _hear(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        ready, _, _ = select.select([self._process.stdout], [], [], PATIENCE)
        if not ready:
            raise WorkerError(f"no answer within {PATIENCE:.0f} s")
        line = self._process.stdout.readline()
        if not line:
            raise WorkerError(self._last_words())
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise WorkerError(answer["error"])
        return answer

    def _last_words(self) -> str:
        self._process.wait(5)
        self._complaints.seek(0)
        lines = self._complaints.read().strip().splitlines()
        return lines[-1] if lines else f"ended with exit code {self._process.returncode}"


def measure_all(
    cases: Sequence[Case], rounds: int, seconds: float, folder: Path, progress: bool = True
) -> list[dict[str, Any]]:
    """Measure all cases once in each round. Every other round goes backwards.

    If a case fails, it keeps its earlier answers and gets an error. Ctrl-C ends the measuring, and
    the results so far are returned.

    Args:
        cases: what to measure.
        rounds: how many times.
        seconds: of each measurement.
        folder: where virtual environments and workers' files are kept.
        progress: whether to show a progress bar.

    Returns:
        For each case: its fields, `about` (what the worker says of itself), `answers` (one for
        each round) and `error` (None if nothing failed).
    """
    results = [_blank(case) for case in cases]
    turns = len(cases) + sum(min(rounds, case.most) for case in cases)
    workers: dict[str, Worker] = {}
    bar = tqdm(total=turns, unit="turn", disable=not progress)

    def say(text: str) -> None:
        bar.write(text, file=sys.stderr)  # stdout is for the results

    try:
        for case, result in zip(cases, results, strict=True):
            bar.set_description(f"start {case.key}")
            try:
                python = interpreter(case.environment, folder / "venvs", say)
                workers[case.key] = Worker(case, python, folder)
                result["about"] = workers[case.key].about
            except (UnavailableError, WorkerError) as error:
                result["error"] = str(error)
            bar.update()
        for turn in range(rounds):
            order = list(zip(cases, results, strict=True))[:: 1 if turn % 2 == 0 else -1]
            for case, result in order:
                if turn >= case.most:
                    continue
                bar.set_description(f"round {turn + 1}/{rounds} {case.key}")
                if result["error"] is None:
                    try:
                        answer = workers[case.key].measure(seconds)
                        result["answers"].append({"round": turn} | answer)
                    except WorkerError as error:
                        result["error"] = str(error)
                bar.update()
    except KeyboardInterrupt:
        say("interrupted: what was measured so far is kept")
        for result in results:
            if result["error"] is None and not result["answers"]:
                result["error"] = "interrupted before it was measured"
    finally:
        bar.close()
        for worker in workers.values():
            worker.close()
    return results


def _blank(case: Case) -> dict[str, Any]:
    fields = {name: getattr(case, name) for name in ("key", "group", "title", "physics")}
    fields |= {"settings": case.settings, "one_core": case.one_core}
    return fields | {"about": {}, "answers": [], "error": None}
