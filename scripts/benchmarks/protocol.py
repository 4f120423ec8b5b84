"""What a worker says and hears: a JSON line about itself, then an answer to each question.

Only the standard library: workers import this in interpreters that have nothing of ours.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from collections.abc import Callable
from typing import Any

#: Measures once for about so many seconds; gives at least `steps` and `seconds`.
Measure = Callable[[float], dict[str, Any]]

#: Gets a worker's settings; gives what measures, and what there is to say about it.
Setup = Callable[[dict[str, Any]], tuple[Measure, dict[str, Any]]]

#: Of the first measurement, which is thrown away (s).
WARM_UP = 0.3


def serve(setup: Setup) -> None:
    """Be a worker: set up, warm up, then measure once for each line, the seconds, on stdin.

    A worker that waits should cost nothing: each answer says what it used while it waited
    (`idle_cpu` s of processor time in `idle` s).
    """
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever libraries print is no answer

    def say(answer: dict[str, Any]) -> None:
        print(json.dumps(answer), file=answers, flush=True)

    settings = json.loads(sys.argv[1])
    if settings.get("one_core"):
        pin_to_one_core()
    try:
        measure, about = setup(settings)
        if settings.get("warm_up", True):
            measure(WARM_UP)
    except Exception as error:  # whatever it is, it is the row's to tell
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
    with contextlib.suppress(AttributeError):  # Linux alone can
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def timed(chunk: Callable[[], int], seconds: float) -> dict[str, Any]:
    """Repeat `chunk`, which gives the steps that it took, until the time is over."""
    steps, begin = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - begin) < seconds or steps == 0:
        steps += chunk()
    return {"steps": steps, "seconds": elapsed}
