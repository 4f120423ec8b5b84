"""From how many random states the wheel ends up walking, and how fast it is caught."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.conditions import Conditions
from agents.outcomes import WALKS, Window, outcomes
from agents.rollout import Rollout
from rimless_gym.envs.starts import normal_force
from rimless_gym.equations import SINGLE
from rimless_gym.hybrid import CONTROL_PERIOD, OK
from rimless_gym.kernel.stepping import MODE, STATE_SIZE
from scripts.studies.feedback_laws.sizes import Sizes
from scripts.studies.feedback_laws.subject import Subject
from trajopt.feedback.controller import NEAR
from trajopt.feedback.law import Floats
from trajopt.feedback.orbit import Orbit, squared_distances

#: Rates reach from minus to plus so much times the gait's largest.
REACH = 1.5

#: For how long a state may take (s), and the time at the end in which it is judged.
SECONDS, JUDGED = 20.0, 4.0

SEED = 20150503


def attraction(subject: Subject, sizes: Sizes) -> dict[str, Any]:
    """The states' rates, which of them walk at the end, and when they came to the gait to stay."""
    orbit = subject.law.data.orbit
    states = random_states(subject, orbit, sizes.states)
    n_intervals = round(SECONDS / sizes.shorter / CONTROL_PERIOD)
    first = n_intervals - round(JUDGED / sizes.shorter / CONTROL_PERIOD)
    walks = Rollout(Conditions(subject.params), subject.policy, states, n_intervals)
    window, late_steps = Window(walks.machines), np.zeros(len(states))
    fallen, last_far = np.zeros(len(states), dtype=bool), np.zeros(len(states))
    for index, interval in enumerate(walks):
        i = interval.running
        fallen[i] = interval.info["failure"] != OK
        far = squared_distances(np.ascontiguousarray(interval.after[:, :4]), orbit) > NEAR**2
        far |= interval.after[:, MODE] != SINGLE
        last_far[i[far]] = CONTROL_PERIOD * (index + 1)
        if index >= first:
            window.add(interval)
            late_steps[i] += interval.info["steps"]
    walking = np.array([v == WALKS for v in outcomes(fallen, late_steps > 0, window)])
    caught = walking & (last_far < CONTROL_PERIOD * first)
    times = [float(t) if there else None for t, there in zip(last_far, caught, strict=True)]
    return {
        "states": len(states),
        "share": float(walking.mean()),
        "caught": float(caught.mean()),
        "median_time": float(np.median(last_far[caught])) if caught.any() else None,
        "rates": states[:, 2:4].round(4).tolist(),
        "walking": walking.tolist(),
        "times": times,
    }


def random_states(subject: Subject, orbit: Orbit, count: int) -> Floats:
    """States (count, STATE_SIZE) in which some voltage presses the foot on the ground.

    Uniform in both angles and both rates, except for those that are left out. They depend on the
    gait only.
    """
    c, rng = subject.params.constants, np.random.default_rng(SEED)
    fastest = REACH * np.abs(orbit.states[:, 2:4]).max(axis=0)
    high, states = np.array([c.b, np.pi, *fastest]), np.zeros((count, STATE_SIZE))
    low, found = np.array([c.a, -np.pi, *-fastest]), 0
    while found < count:
        states[found, :4] = rng.uniform(low, high)
        found += normal_force(subject.params, states[found], subject.params.voltage_limit) > 0.0
    return states
