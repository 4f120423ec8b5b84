"""Walks that a search asks for, and what it is told about them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from agents.evolution.asking import Among, Answer, Request
from agents.evolution.walks import Walks, World
from agents.evolution.worth import Worth, families, members, senses
from agents.pacing import NO_WALK
from agents.rollout import draw_starts


def answered(request: Request, world: World, worth: Worth) -> Answer:
    """Let the policies of a request walk, and judge them as it asks."""
    starts = draw_starts(world.params, request.starts, request.seed)
    walks = world.walk(request.weights, starts, request.duration)
    groups, belongs = _groups(request.among, walks)
    worths = np.empty((len(groups), len(request.weights)))
    for k, group in enumerate(groups):
        worths[k] = worth.of(walks, request.duration, group, request.price, request.judged)
        worths[k, ~belongs[k]] = -np.inf
    gait = NO_WALK
    if len(groups):
        gait = worth.gait(walks, request.duration, groups[0])
    return Answer(groups.astype(np.float64), worths, gait)


def _groups(among: int | Among, walks: Walks) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The groups (G,) into which policies are sorted, and which belong to each of them, (G, P)."""
    if among is Among.SENSES:
        groups = np.array([0, -1, 1])
        return groups, np.array([(senses(walks) == sense).any(axis=1) for sense in groups])
    if among is Among.FAMILIES:
        groups = families(walks)
        own = [members(walks, family).any(axis=1) for family in groups]
        return groups, np.array(own, dtype=bool).reshape(len(groups), len(walks.steps))
    return np.array([among]), np.ones((1, len(walks.steps)), dtype=bool)
