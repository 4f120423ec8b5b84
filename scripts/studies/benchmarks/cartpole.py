"""Kelly's cart-pole swing-up, which every optimal control tool solves.

M. Kelly, An Introduction to Trajectory Optimization, SIAM Review 59 (2017), section 6: the pole
swings from rest below to rest above in 2 s while the cart moves by 1 m, with the least integral of
the squared force. Every tool uses 40 segments, and guesses a straight line between the ends, with
rates and force 0.

This file uses only the standard library, because peers' environments do not have our packages.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any

#: Masses (kg) of cart and pole, length of the pole (m), gravity (m/s^2).
CART, POLE, LENGTH, GRAVITY = 1.0, 0.3, 0.5, 9.81

#: Largest force (N), largest distance of the cart from its start (m), and duration (s).
FORCE, TRACK, DURATION = 20.0, 2.0, 2.0

#: Position of the cart (m), angle of the pole from below (rad), and their rates.
START, END = (0.0, 0.0, 0.0, 0.0), (1.0, math.pi, 0.0, 0.0)

SEGMENTS = 40

#: The least cost (N^2 s), and by which share of it other discretisations may differ.
COST, TOLERANCE = 58.81, 0.03


def derivative(
    x: Sequence[Any], u: Any, sin: Callable[[Any], Any], cos: Callable[[Any], Any]
) -> Any:
    """The rates of change of a state `x` under a force `u`, as a list, for any type of number."""
    s, c = sin(x[1]), cos(x[1])
    inertia, push = CART + POLE * s**2, u + LENGTH * POLE * s * x[3] ** 2
    cart = (push + POLE * GRAVITY * s * c) / inertia
    pole = -(push * c + (CART + POLE) * GRAVITY * s) / (LENGTH * inertia)
    return [x[2], x[3], cart, pole]


def line(part: float) -> list[float]:
    """The guess of the state after a part (0 to 1) of the time: on a straight line, rates 0."""
    return [part * END[0], part * END[1], 0.0, 0.0]


def repeated(once: Callable[[], dict[str, float]], seconds: float) -> dict[str, Any]:
    """Build and solve again and again until the time is over.

    Args:
        once: builds and solves. It returns `build` and `solve` (s), `iterations` and `cost`.
        seconds: how long to repeat it.

    Returns:
        The number of repetitions (`steps`), the time that they took (`seconds`), and the medians of
        what `once` returned and of building and solving together (`total`).

    Raises:
        RuntimeError: no optimum was found, or a different one.
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
