"""What a worker writes and reads: a JSON line about itself, then an answer to each question.

This file uses only the standard library, because peers' environments do not have our packages.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

#: Measures once for about so many seconds, and returns at least `steps` and `seconds`.
Measure = Callable[[float], dict[str, Any]]

#: Takes a worker's settings, and returns a function that measures and what the worker says of
#: itself.
Setup = Callable[[dict[str, Any]], tuple[Measure, dict[str, Any]]]

#: Duration of the first measurement, which does not count (s).
WARM_UP = 0.3


def serve(setup: Setup) -> None:
    """Be a worker: set up, warm up, then measure once for each line on stdin, a number of seconds.

    A worker that waits should not slow the others down. Each answer therefore says for how long it
    waited (`idle`, s) and how much processor time it used meanwhile (`idle_cpu`, s).
    """
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # libraries that print would disturb the answers

    def say(answer: dict[str, Any]) -> None:
        print(json.dumps(answer), file=answers, flush=True)

    settings = json.loads(sys.argv[1])
    if settings.get("one_core"):
        pin_to_one_core()
    try:
        measure, about = setup(settings)
        if settings.get("warm_up", True):
            measure(WARM_UP)
    except Exception as error:  # of any kind: the row shows it
        say({"error": f"{type(error).__name__}: {error}"})
        raise
    say(about)
    waiting, used = time.monotonic(), time.process_time()
    for line in sys.stdin:
        idle = {"idle": time.monotonic() - waiting, "idle_cpu": time.process_time() - used}
        try:
            say(measure(float(line)) | idle)
        except Exception as error:
            say({"error": f"{type(error).__name__}: {error}"})
            raise
        waiting, used = time.monotonic(), time.process_time()


def pin_to_one_core() -> None:
    """Keep this process, and the threads that it starts from now on, to one core."""
    with contextlib.suppress(AttributeError):  # only Linux can
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def timed(chunk: Callable[[], int], seconds: float) -> dict[str, Any]:
    """Repeat `chunk`, which returns how many steps it took, until the time is over."""
    steps, begin = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - begin) < seconds or steps == 0:
        steps += chunk()
    return {"steps": steps, "seconds": elapsed}
