"""What hyperparameters cannot lead to walking, told before hours are spent on them."""

from __future__ import annotations

import math

from agents.sb3.hyperparameters import Hyperparameters
from agents.training import SCRATCH, Training

#: Speed of the step whose length in time a learner should look ahead (m/s).
USUAL_SPEED = 0.5

#: Cost of transport of the simplest walk, that under a constant voltage; see docs/learning.md.
SIMPLEST_COT = 1.0

#: The discount factor of stable-baselines3's algorithms.
USUAL_GAMMA = 0.99


def advice(training: Training, settings: Hyperparameters) -> list[str]:
    """Why a training will not learn to walk, each reason with its numbers; usually none."""
    return [
        reason
        for reason in (
            _short_sight(training, settings),
            _low_price(training, settings),
            _held_for_long(training, settings),
        )
        if reason
    ]


def _short_sight(training: Training, settings: Hyperparameters) -> str:
    """A discount under which the end of a step is not seen from its beginning."""
    gamma = float(settings.algorithm.get("gamma", USUAL_GAMMA))
    if gamma >= 1.0:
        return ""
    held = settings.intervals_per_step * training.conditions.control.period
    horizon, step = held / (1.0 - gamma), training.conditions.params.step_length / USUAL_SPEED
    if horizon >= step:
        return ""
    return (
        f"gamma = {gamma:g}: with actions of {1e3 * held:g} ms the learner looks {horizon:.2g} s "
        f"ahead, and a step at {USUAL_SPEED} m/s lasts {step:.2g} s; take a gamma of at least "
        f"{math.ceil(1e3 * (1.0 - held / step)) / 1e3:g}, or hold actions for longer"
    )


def _low_price(training: Training, settings: Hyperparameters) -> str:
    """A price at which a policy that does not walk yet had better stand still."""
    if training.init != SCRATCH:
        return ""
    name, price = "distance_weight", training.task.distance_weight
    if settings.pacing is not None and settings.pacing.first_price > price:
        name, price = "first_price", settings.pacing.first_price
    if price >= SIMPLEST_COT:
        return ""
    return (
        f"{name} = {price:g} from scratch: the simplest walk costs about "
        f"{SIMPLEST_COT:g} per metre, so standing still pays better; let the price follow the "
        "policy (agents.sb3.pacing.SelfPacedPrice), or start from a clone"
    )


def _held_for_long(training: Training, settings: Hyperparameters) -> str:
    """An action that lasts for more than half a step."""
    held = settings.intervals_per_step * training.conditions.control.period
    step = training.conditions.params.step_length / USUAL_SPEED
    if held <= 0.5 * step:
        return ""
    return (
        f"actions are held for {held:g} s, and a step at {USUAL_SPEED} m/s lasts {step:.2g} s: "
        "no gait can be controlled so seldom; hold them for fewer intervals"
    )
