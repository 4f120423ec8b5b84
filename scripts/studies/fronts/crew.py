"""Processes that do the search's work, and the budget that it must keep."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from itertools import islice
from typing import Any, TypeAlias, TypeVar

from tqdm import tqdm

from trajopt.processes import pool

T = TypeVar("T")

#: (function, inputs) -> (input, function of it), as they come.
Crew: TypeAlias = Callable[[Callable[[Any], Any], Iterable[Any]], Generator[tuple[Any, Any]]]


@contextmanager
def crew(workers: int) -> Iterator[Crew]:
    """So many processes, or this one alone; they take inputs one by one, so that all may stop."""
    if workers == 1:
        yield _in_turn
        return
    with pool(workers) as submit:

        def shared(function: Callable[[Any], Any], inputs: Iterable[Any]) -> Generator[Any]:
            running: dict[Future[Any], Any] = {}
            remaining = iter(inputs)
            while True:
                for each in islice(remaining, workers - len(running)):
                    running[submit(function, each)] = each
                if not running:
                    return
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    yield running.pop(future), future.result()

        yield shared


def _in_turn(function: Callable[[Any], Any], inputs: Iterable[Any]) -> Generator[Any]:
    yield from ((each, function(each)) for each in inputs)


def while_affordable(inputs: Iterable[T], affordable: Callable[[], bool]) -> Iterator[T]:
    """The inputs for as long as there is budget left."""
    for each in inputs:
        if not affordable():
            return
        yield each


def bar(total: int, title: str) -> tqdm:
    """A progress bar of one round of work."""
    return tqdm(total=total, desc=title, unit="piece", smoothing=0.1, mininterval=20)
