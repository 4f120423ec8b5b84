"""Which limits a gait reaches, and for how long."""

from __future__ import annotations

import numpy as np

from rimless_gym import hybrid
from rimless_gym.symbolic import HybridModel
from trajopt.gaits.problem import MIN_NORMAL_FORCE
from trajopt.gaits.solution import Solution


def binding(gait: Solution) -> dict[str, float]:
    """The share of a stride's time during which each limit is reached, by name."""
    t = np.linspace(0.0, gait.duration, 4001)[:-1]
    x, volts = gait.state(t), gait.control(t)
    reaction = HybridModel(gait.params).functions["ground_reaction"].map(len(t))
    fx, fy = np.array(reaction(x.T, volts))
    mu, weight, limit = gait.params.friction, gait.params.weight, gait.params.voltage_limit
    reached = {
        "voltage": np.abs(volts) > 0.999 * limit,
        "friction (forward)": fx > 0.999 * mu * fy,
        "friction (backward)": -fx > 0.999 * mu * fy,
        "normal force": fy < 1.01 * MIN_NORMAL_FORCE * weight,
        "rate": np.abs(x[:, 3]) > 0.999 * hybrid.MAX_RATE,
    }
    return {name: float(np.mean(where)) for name, where in reached.items()}
