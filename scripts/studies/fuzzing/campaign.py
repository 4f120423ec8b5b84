"""Many trials, shared among processes that may lock up, crash or be interrupted."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import multiprocessing
import multiprocessing.connection
import signal
import sys
import time
import traceback
from typing import Any

from tqdm import tqdm

from scripts.studies.fuzzing.tally import Case, Tally
from scripts.studies.fuzzing.trial import Trial, warm_up

#: Longest time (s) that a trial may take, even on a busy machine.
PATIENCE = 300.0


@dataclasses.dataclass(frozen=True)
class Extent:
    """How long a campaign is. Exactly one of the attributes must be given.

    Attributes:
        steps: control intervals, of all rows together.
        seeds: trials.
        seconds: time.
    """

    steps: int | None = None
    seeds: int | None = None
    seconds: float | None = None

    def done(self, tally: Tally, elapsed: float) -> float:
        """How much is done, in the unit of `total`."""
        if self.steps is not None:
            return tally.steps
        return tally.seeds if self.seeds is not None else elapsed

    @property
    def total(self) -> float:
        """Steps, trials or seconds in all."""
        [total] = [x for x in (self.steps, self.seeds, self.seconds) if x is not None]
        return total

    @property
    def unit(self) -> str:
        """The unit of `total`."""
        return "step" if self.steps is not None else "trial" if self.seeds is not None else "s"


class Worker:
    """A process that runs trials. It ends when the calling process ends.

    Attributes:
        connection: on which it sends its results.
        seed: of its trial.
        since: when the trial began, by `time.monotonic`.
    """

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()
        self.seed, self.since = -1, time.monotonic()

    def start(self, seed: int) -> None:
        """Begin a trial."""
        self.seed, self.since = seed, time.monotonic()
        self.connection.send(seed)

    def result(self) -> Tally:
        """The tally of its trial, which has ended or is overdue, or whose process has ended."""
        if self.overdue and not self.connection.poll():
            self.kill()
            return self._without(f"it locked up: no result within {PATIENCE:.0f} s")
        try:
            tally: Tally = self.connection.recv()
        except (EOFError, OSError):
            self._process.join()
            return self._without(f"the process ended with exit code {self._process.exitcode}")
        return tally

    def _without(self, trouble: str) -> Tally:
        return Tally(seeds=1, cases=(Case(self.seed, trouble),))

    @property
    def overdue(self) -> bool:
        """Whether its trial takes longer than `PATIENCE`."""
        return time.monotonic() - self.since > PATIENCE

    @property
    def alive(self) -> bool:
        """Whether it can run another trial."""
        return self._process.is_alive()

    def kill(self) -> None:
        """End it."""
        self._process.kill()
        self._process.join()
        self.connection.close()


def _serve(connection: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent to handle
    warm_up()
    with contextlib.suppress(EOFError, OSError):  # the parent has gone
        while True:
            connection.send(outcome(connection.recv()))


def outcome(seed: int) -> Tally:
    """The tally of a trial. An unexpected exception is a failure too."""
    try:
        return Trial(seed).run()
    except Exception:
        return Tally(seeds=1, cases=(Case(seed, traceback.format_exc()),))


def campaign(first: int, extent: Extent, workers: int) -> tuple[Tally, bool]:
    """Run trials from seed `first` on, and print failures as they are found.

    Args:
        first: seed of the first trial.
        extent: how long to go on.
        workers: number of processes.

    Returns:
        The sum over all trials that ended, and whether Ctrl-C ended the campaign.
    """
    tally, interrupted, seeds = Tally(), False, itertools.count(first)
    running = [Worker() for _ in range(min(workers, extent.seeds or workers))]
    last = None if extent.seeds is None else first + extent.seeds
    began = time.monotonic()
    try:
        with tqdm(total=extent.total, unit=extent.unit, unit_scale=True) as bar:
            for worker in running:
                worker.start(next(seeds))
            while running:
                for worker in _ready(running):
                    result = worker.result()
                    tally += result
                    for case in result.cases:
                        bar.write(str(case), file=sys.stderr)
                    done = extent.done(tally, time.monotonic() - began)
                    bar.set_postfix_str(f"{len(tally.cases)} failures", refresh=False)
                    bar.update(min(done, extent.total) - bar.n)
                    seed = next(seeds)
                    running.remove(worker)
                    if done >= extent.total or (last is not None and seed >= last):
                        worker.kill()
                        continue
                    if not worker.alive:
                        worker = Worker()
                    worker.start(seed)
                    running.append(worker)
    except KeyboardInterrupt:
        interrupted = True
    finally:
        for worker in running:
            worker.kill()
    return tally, interrupted


def _ready(running: list[Worker]) -> list[Worker]:
    """The workers that have a result within a second, or whose trial is overdue."""
    ready = multiprocessing.connection.wait([worker.connection for worker in running], 1.0)
    return [worker for worker in running if worker.connection in ready or worker.overdue]
