"""The policies that evolve: an action linear in products of what is observed, so smooth.

    a = clip(w . f(o), -1, 1)

f has a constant, the six numbers of the observation, two harmonics of the pendulum's angle, and
products of angles and rates: enough for a servo of the pendulum's rate with a bias, and for
corrections that depend on where the leg and the pendulum are.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rimless_gym.jit import cached, inner
from trajopt.feedback.law import Floats

#: Numbers of a policy.
SIZE = 21


@inner
def features(leg, sine, cosine, leg_rate, rate, resting):  # type: ignore[no-untyped-def]
    """f (SIZE) of the observation's six numbers (`rimless_gym.envs.layout`)."""
    return (
        1.0,
        leg,
        sine,
        cosine,
        leg_rate,
        rate,
        resting,
        2.0 * sine * cosine,
        cosine * cosine - sine * sine,
        leg * sine,
        leg * cosine,
        leg_rate * sine,
        leg_rate * cosine,
        rate * sine,
        rate * cosine,
        leg * leg_rate,
        leg * rate,
        leg_rate * rate,
        leg * leg,
        rate * abs(rate),
        resting * sine,
    )


@inner
def action(weights, i, seen):  # type: ignore[no-untyped-def]
    """The action in [-1, 1] of policy i of `weights` (n, SIZE) for an observation."""
    found, total = features(*seen), 0.0
    for k in range(len(found)):
        total += weights[i, k] * found[k]
    return min(max(total, -1.0), 1.0)


def act(weights: Floats, observations: NDArray[np.float32]) -> Floats:
    """Actions (N,) of one policy (SIZE,) for observations (N, 6)."""
    actions = np.empty(len(observations))
    _act(weights.reshape(1, SIZE), observations.astype(np.float64), actions)
    return actions


@cached()
def _act(weights, observations, actions):  # type: ignore[no-untyped-def]
    for i in range(len(actions)):
        o = observations[i]
        actions[i] = action(weights, 0, (o[0], o[1], o[2], o[3], o[4], o[5]))
