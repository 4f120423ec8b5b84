"""Solving the starts of a search, in this process alone or shared with others."""

from __future__ import annotations

from collections.abc import Generator, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from itertools import islice
from typing import TypeAlias

from trajopt.ocp.search.optima import Outcome
from trajopt.ocp.search.search import Search
from trajopt.ocp.solving.minimum import minimum
from trajopt.ocp.transcribe.nlp import Transcription
from trajopt.processes import pool

#: Starts that another process holds at a time: the one that it solves, and the next.
AHEAD = 2

#: Outcomes as they come. Closing it ends the other processes.
Outcomes: TypeAlias = Generator[Outcome, None, None]


class Solver:
    """Solves a search's starts on one transcription.

    Attributes:
        search: whose starts they are.
        transcription: of its problem on its mesh.
    """

    def __init__(self, search: Search) -> None:
        self.search = search
        self.transcription = Transcription(search.problem, search.mesh)

    def outcome(self, index: int) -> Outcome:
        """Solve start number `index`: its problems one after the other."""
        start = self.search.start(index)
        guess, parameters, iterations = start.guess, start.parameters, 0
        for problem in start.problems:
            result = minimum(self.transcription, guess, problem, parameters, **self.search.options)
            guess, parameters = result.phases, result.parameters
            iterations += result.iterations
        failure = "" if result.success else f"{result.status}: {result.worst}"
        found = result.cost, result.phases, result.parameters
        return Outcome(index, start.kind, *found, iterations, failure)


def outcomes_of(search: Search, indices: Iterable[int], workers: int) -> Outcomes:
    """Solve starts of a search.

    Args:
        search: with everything but its outcomes.
        indices: of the starts to be solved.
        workers: processes, this one included.

    Returns:
        The outcomes: in the order of `indices` with one worker, otherwise as they come.
    """
    return _in_turn(search, indices) if workers == 1 else _shared(search, indices, workers - 1)


def _in_turn(search: Search, indices: Iterable[int]) -> Outcomes:
    solver = Solver(search)
    yield from map(solver.outcome, indices)


def _shared(search: Search, indices: Iterable[int], others: int) -> Outcomes:
    """This process solves starts too, because the others take a second to begin."""
    remaining, solver = iter(indices), Solver(search)
    running: set[Future[Outcome]] = set()
    with pool(others, _start_worker, search) as submit:
        while True:
            ahead = AHEAD * others - len(running)
            running |= {submit(_work, index) for index in islice(remaining, ahead)}
            own = next(remaining, None)
            if own is not None:
                yield solver.outcome(own)
            elif not running:
                return
            patience = None if own is None else 0.0
            done, running = wait(running, patience, FIRST_COMPLETED)
            yield from (future.result() for future in done)


#: The solver of a process that `_shared` started.
_worker: Solver


def _start_worker(search: Search) -> None:
    global _worker
    _worker = Solver(search)


def _work(index: int) -> Outcome:
    return _worker.outcome(index)
