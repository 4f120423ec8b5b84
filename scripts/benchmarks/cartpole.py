"""Kelly's cart-pole swing-up, which every optimal control tool is to solve.

M. Kelly, An Introduction to Trajectory Optimization, SIAM Review 59 (2017), section 6: from rest
below to rest above, the cart 1 m further, in 2 s; the integral of the squared force is to be
least. Every tool has 40 segments, and starts from the straight line between the ends, at rest
and without force.

Only the standard library: workers import this in interpreters that have nothing of ours.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

#: Masses (kg) of cart and pole, length of the pole (m), gravity (m/s^2).
CART, POLE, LENGTH, GRAVITY = 1.0, 0.3, 0.5, 9.81

#: Largest force (N), furthest place (m), and how long it takes (s).
FORCE, TRACK, DURATION = 20.0, 2.0, 2.0

#: The cart's place, the pole's angle from below, and their rates.
START, END = (0.0, 0.0, 0.0, 0.0), (1.0, math.pi, 0.0, 0.0)

SEGMENTS = 40

#: The least cost (N^2 s), and by how much of it other discretisations may differ.
COST, TOLERANCE = 58.81, 0.03


def derivative(
    x: Sequence[Any], u: Any, sin: Callable[[Any], Any], cos: Callable[[Any], Any]
) -> Any:
    """The rates of change of a state under a force, as a list, of any kind of number."""
    s, c = sin(x[1]), cos(x[1])
    inertia, push = CART + POLE * s**2, u + LENGTH * POLE * s * x[3] ** 2
    cart = (push + POLE * GRAVITY * s * c) / inertia
    pole = -(push * c + (CART + POLE) * GRAVITY * s) / (LENGTH * inertia)
    return [x[2], x[3], cart, pole]


def line(part: float) -> list[float]:
    """The guess of the state after a part of the time, 0 to 1: a straight line, at rest."""
    return [part * END[0], part * END[1], 0.0, 0.0]


def repeated(once: Callable[[], dict[str, float]], seconds: float) -> dict[str, Any]:
    """Repeat `once`, which builds and solves, until the time is over.

    Args:
        once: gives `build` and `solve` (s), `iterations` and `cost`.
        seconds: how long.

    Returns:
        How often (`steps`) in which time (`seconds`), and the medians of the four and of building
        and solving in all (`total`).

    Raises:
        RuntimeError: another optimum was found, or none.
    """
    answers: list[dict[str, float]] = []
    begin = time.perf_counter()
    while (elapsed := time.perf_counter() - begin) < seconds or not answers:
        answer = once()
        if not abs(answer["cost"] - COST) <= TOLERANCE * COST:
            raise RuntimeError(f"a cost of {answer['cost']:.4g} N^2 s instead of {COST}")
        answers.append(answer | {"total": answer["build"] + answer["solve"]})
    medians = {name: median(answer[name] for answer in answers) for name in answers[0]}
    return {"steps": len(answers), "seconds": elapsed} | medians
