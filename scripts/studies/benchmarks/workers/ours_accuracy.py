"""How far our stepping kernel is from the reference simulator over 2 s of the walking gait."""

from __future__ import annotations

import time
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from rimless_gym import simulate
from rimless_gym.energy import ROW
from rimless_gym.equations import MODE_NAMES
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import MODE, STATE_SIZE, advance

from ..protocol import Measure, serve
from ..walks import PARAMS, Floats, Walks, load_walks


def setup(settings: dict[str, Any]) -> tuple[Measure, dict[str, Any]]:
    """Each measurement compares some pieces of walks, and gives the largest errors."""
    walks = load_walks(Path(settings["folder"]))
    pieces = count()

    def measure(seconds: float) -> dict[str, Any]:
        begin = time.perf_counter()
        errors: list[dict[str, float]] = []
        while time.perf_counter() - begin < seconds or not errors:
            errors.append(compare(walks.piece(37 * next(pieces) % len(walks.starts))))
        return {
            "steps": len(errors),
            "seconds": time.perf_counter() - begin,
            **{name: max(error[name] for error in errors) for name in errors[0]},
        }

    return measure, {"version": "rimless-gym"}


def compare(walk: Walks) -> dict[str, float]:
    """Largest errors of one piece of 2 s.

    Returns:
        `state_error`: of the states (rad, rad/s) at the ends of the control intervals, where kernel
        and reference have the same start and walk on their own. `event_error`: of the times of
        touchdowns (s), where the kernel starts from the reference's state at the beginning of the
        touchdown's control interval. `event_drift`: of the same times (s), where both walk on their
        own; without feedback the gait magnifies rounding errors.

    Raises:
        RuntimeError: the two have different numbers of touchdowns.
    """
    volts = PARAMS.voltage_limit * walk.actions[:, 0].astype(np.float64)
    mode = MODE_NAMES[walk.modes[0]]
    reference = simulate(PARAMS, walk.starts[0], volts, CONTROL_PERIOD * len(volts), mode=mode)
    state = np.zeros((1, STATE_SIZE))
    state[0, :4], state[0, MODE] = walk.starts[0], walk.modes[0]
    located: list[float] = []
    drifted: list[float] = []
    error = 0.0
    for i, u in enumerate(volts):
        begin, before = CONTROL_PERIOD * i, state.copy()
        theirs = np.array([[*reference.state(begin), *state[0, 4:]]])
        touchdowns = int(advance(PARAMS, state, np.array([u]))[0, ROW.touchdowns])
        for number in range(1, touchdowns + 1):
            located.append(begin + touchdown_time(theirs, u, number))
            drifted.append(begin + touchdown_time(before, u, number))
        after = reference.state(begin + CONTROL_PERIOD)
        error = max(error, float(np.abs(state[0, :4] - after).max()))
    times = [event.time for event in reference.touchdowns]
    if len(times) != len(located):
        raise RuntimeError(f"{len(located)} touchdowns, {len(times)} by the reference")
    return {
        "state_error": error,
        "event_error": float(np.abs(np.subtract(located, times)).max(initial=0.0)),
        "event_drift": float(np.abs(np.subtract(drifted, times)).max(initial=0.0)),
    }


def touchdown_time(state: Floats, u: float, number: int) -> float:
    """When in the interval the kernel finds its touchdown of that number (s), by bisection."""
    early, late = 0.0, CONTROL_PERIOD
    while early < (middle := (early + late) / 2) < late:
        rows = advance(PARAMS, state.copy(), np.array([u]), middle)
        early, late = (early, middle) if rows[0, ROW.touchdowns] >= number else (middle, late)
    return late


if __name__ == "__main__":
    serve(setup)
