"""Cost over the environment's own optimum, and how many starts walk.

Averages are interquartile means over the sets of starts, as their intervals are.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from agents.evaluate import (
    PROTOCOL,
    Evaluation,
    Protocol,
    bootstrap_interval,
    evaluate,
    interquartile_mean,
)
from scripts.studies.feedback_laws.sizes import Sizes
from scripts.studies.feedback_laws.subject import Subject

#: Between the seeds of two sets of starts.
APART = 1000


def cost(subject: Subject, sizes: Sizes) -> dict[str, Any]:
    """The full protocol from several sets of starts; the first set is the protocol's own."""
    walks = [
        evaluate(subject.policy, subject.params, _protocol(sizes, PROTOCOL.seed + APART * k))
        for k in range(sizes.seeds)
    ]
    gaps = [walk.cot / subject.gait.cot - 1 for walk in walks if walk.walking.any()]
    shares = [walk.walking_share for walk in walks]
    return {
        "seeds": sizes.seeds,
        "starts": sizes.starts,
        "share": interquartile_mean(shares),
        "share_interval": bootstrap_interval(shares),
        "gap": interquartile_mean(gaps) if gaps else None,
        "gap_interval": bootstrap_interval(gaps) if gaps else None,
        "gaps": gaps,
        "speed": _mean([walk.speed for walk in walks]),
        "friction_demand": _worst(walks, "friction_demand", 1.0),
        "impulse_friction_demand": _worst(walks, "impulse_friction_demand", 1.0),
        "least_force": _worst(walks, "min_normal_force_over_weight", -1.0),
        "faults": _faults(walks),
    }


def _protocol(sizes: Sizes, seed: int) -> Protocol:
    times = (PROTOCOL.duration, PROTOCOL.window, PROTOCOL.alive)
    duration, window, alive = (seconds / sizes.shorter for seconds in times)
    return dataclasses.replace(
        PROTOCOL, starts=sizes.starts, seed=seed, duration=duration, window=window, alive=alive
    )


def _mean(values: list[float]) -> float | None:
    known = [value for value in values if np.isfinite(value)]
    return interquartile_mean(known) if known else None


def _worst(walks: list[Evaluation], name: str, sign: float) -> float | None:
    """The largest of a figure, or with -1 the least, of all sets of starts."""
    known = [sign * each for walk in walks if np.isfinite(each := getattr(walk, name))]
    return sign * max(known) if known else None


def _faults(walks: list[Evaluation]) -> dict[str, int]:
    total: dict[str, int] = {}
    for walk in walks:
        for name, count in walk.failures.items():
            total[name] = total.get(name, 0) + count
    return total
