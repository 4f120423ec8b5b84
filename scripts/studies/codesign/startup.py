"""From how many starts the feedback law has joined its gait within ten seconds."""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.evaluate import Protocol, evaluate
from agents.policies import controller_policy
from rimless_gym.hybrid import motor_torque, relative_rate
from scripts.studies.codesign.problem import chosen
from trajopt.feedback import laws
from trajopt.gaits.solution import Solution

#: Seconds until a start must be in the gait, and over which its speed is then measured.
JOINED, MEASURED = 10.0, 4.0

#: Deviation of that speed from the gait's (relative) up to which a start is in the gait.
SAME_SPEED = 0.05


def joined(gait: Solution, starts: int) -> dict[str, Any]:
    """How the law for a gait starts, and figures of the gait, as plain JSON values."""
    policy = controller_policy(gait.params, laws.design("lqr", gait))
    protocol = Protocol(
        starts=starts, duration=JOINED + MEASURED, window=MEASURED, alive=MEASURED / 2
    )
    walk = evaluate(policy, gait.params, protocol)
    near = np.abs(walk.speeds / gait.speed - 1) < SAME_SPEED
    return figures(gait) | {
        "starts": starts,
        "joined": float(np.mean(walk.walking & near)),
        "walking": walk.walking_share,
        "cot_of_walks": walk.cot if walk.walking.any() else None,
    }


def judged(gait: Solution) -> dict[str, Any]:
    """`joined` from all starts of the protocol, and how they walk at the protocol's end."""
    walk = evaluate(controller_policy(gait.params, laws.design("lqr", gait)), gait.params)
    return joined(gait, walk.protocol.starts) | {
        "walking": walk.walking_share,
        "cot_of_walks": walk.cot if walk.walking.any() else None,
    }


def figures(gait: Solution) -> dict[str, Any]:
    """Figures of a gait and its machine as plain JSON values."""
    v, (bob, arm) = gait.verification, chosen(gait.params)
    t = np.linspace(0.0, gait.duration, 400, endpoint=False)
    x, p = gait.state(t), gait.params
    rate = relative_rate(x[:, 2], x[:, 3], p.constants)
    torque = motor_torque(rate, gait.control(t), p.constants)
    return {
        "legs": p.n_legs,
        "ratio": p.gear_ratio,
        "bob": bob,
        "arm": arm,
        "turns": gait.theta_turns,
        "cot": gait.cot,
        "speed": gait.speed,
        "multiplier": float(abs(gait.floquet[0])),
        "friction_demand": max(v.max_friction_demand, v.max_impulse_friction_demand),
        "normal_force": v.min_normal_force_over_weight,
        "clearance": v.clearance,
        "peak_voltage": v.peak_voltage,
        "peak_torque": float(np.abs(torque).max()),
        "motor_speed": float(np.abs(rate).max() * p.gear_ratio),
    }
