"""How long a decision takes, for a wheel by itself and in a batch."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from rimless_gym.equations import SINGLE
from scripts.studies.feedback_laws.sizes import Sizes
from scripts.studies.feedback_laws.subject import Subject
from trajopt.feedback.controller import ContactGuard, SwitchingController
from trajopt.feedback.law import Controller, Floats

#: Wheels of a batch.
BATCH = 128

#: For how long calls are repeated (s), and how often; the best of these counts.
SECONDS, REPEATS = 0.1, 5


def timing(subject: Subject, sizes: Sizes) -> dict[str, Any]:
    """Seconds per decision on the gait, where the catch is not asked."""
    controller = ContactGuard(subject.params, SwitchingController(subject.law, _no_startup))
    t = subject.gait.duration * (np.arange(BATCH) + 0.5) / BATCH
    states, modes = subject.gait.state(t), np.full(BATCH, SINGLE)
    single = [state.copy() for state in states]
    return {
        "single": min(_mean_time(controller, single) for _ in range(REPEATS)),
        "batch": min(_mean_time(controller, [states], modes) for _ in range(REPEATS)) / BATCH,
    }


def _no_startup(x: Floats, mode: Any) -> Floats:
    return np.zeros(len(x))


def _mean_time(controller: Controller, states: list[Floats], mode: Any = SINGLE) -> float:
    """Mean time of a call (s), over at least `SECONDS`, after a first call that may compile."""
    controller(states[0], mode)
    calls, begin = 0, time.perf_counter()
    while (spent := time.perf_counter() - begin) < SECONDS:
        controller(states[calls % len(states)], mode)
        calls += 1
    return spent / calls
