"""Walks as pictures, drawn by the environment's own renderer."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator

import numpy as np

from agents.rollout import Interval
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.kernel.stepping import FOOT, MODE, PHI, THETA
from rimless_gym.params import WheelParams
from rimless_gym.rendering.wheel import Frame, Scene, draw
from trajopt.gaits.solution import Solution

#: Seconds over which the speed and the cost of transport in the picture are averaged.
AVERAGED = 2.0

#: Neither is shown before the hub has travelled so far in that time (m): both would mean nothing.
LEAST_TRAVEL = 0.3

#: Pictures through which the hub's trail reaches back.
TRAIL = 40


def film(
    params: WheelParams,
    walk: Iterable[Interval],
    *,
    fps: int = 25,
    size: tuple[int, int] = (600, 360),
    period: float = CONTROL_PERIOD,
) -> Iterator[Frame]:
    """Pictures of the first of some walks.

    Args:
        params: the machine.
        walk: its control intervals.
        fps: pictures per second of the walk; a state is shown until the next one is due.
        size: width and height in pixels.
        period: length of an interval (s).

    Yields:
        Pixels, uint8 of shape (height, width, 3).
    """
    recent: deque[tuple[float, float]] = deque(maxlen=max(1, round(AVERAGED / period)))
    trail: deque[tuple[float, float]] = deque(maxlen=TRAIL)
    shown = 0
    for k, interval in enumerate(walk):
        info, state = interval.info, interval.states[0]
        due = math.ceil((k + 1) * period * fps - 1e-9)  # pictures until the end of the interval
        if due > shown:
            energy, distance = map(sum, zip(*recent, strict=True)) if recent else (0.0, 0.0)
            moving = distance > LEAST_TRAVEL
            scene = Scene(
                phi=float(state[PHI]),
                theta=float(state[THETA]),
                mode=int(state[MODE]),
                foot_x=float(state[FOOT]) * params.step_length,
                voltage=params.voltage_limit * float(interval.actions[0]),
                time=k * period,
                speed=distance / (len(recent) * period) if moving else None,
                cot=energy / (params.weight * distance) if moving else None,
            )
            trail.append(scene.hub(params))
            picture = draw(params, scene, size=size, trail=tuple(trail))
            yield from [picture] * (due - shown)
            shown = due
        drawn = float(info["electrical_positive"][0] + info["idle"][0])
        recent.append((drawn, float(info["distance"][0])))


def film_of_gait(
    gait: Solution, seconds: float, *, fps: int = 25, size: tuple[int, int] = (600, 360)
) -> Iterator[Frame]:
    """Pictures of a gait, stride after stride, as it was solved.

    Args:
        gait: the gait.
        seconds: of walking.
        fps: pictures per second.
        size: width and height in pixels.

    Yields:
        Pixels, uint8 of shape (height, width, 3).
    """
    params, times = gait.params, np.arange(round(seconds * fps)) / fps
    states, volts = gait.state(times % gait.duration), gait.control(times % gait.duration)
    fine = np.union1d(times, np.arange(0.0, seconds, CONTROL_PERIOD))  # no touchdown is skipped
    legs = gait.state(fine % gait.duration)[:, 0]
    touchdowns = np.concatenate([[0], np.cumsum(np.abs(np.diff(legs)) > params.leg_angle / 2)])
    steps = touchdowns[np.searchsorted(fine, times)]
    trail: deque[tuple[float, float]] = deque(maxlen=TRAIL)
    for t, state, voltage, step in zip(times, states, volts, steps, strict=True):
        scene = Scene(
            phi=float(state[0]),
            theta=float(state[1]),
            foot_x=float(step) * params.step_length,
            voltage=float(voltage),
            time=float(t),
            speed=gait.speed,
            cot=gait.cot,
        )
        trail.append(scene.hub(params))
        yield draw(params, scene, size=size, trail=tuple(trail))
