"""The search for a gait, from nothing: screen, race, refine.

1. **Screen**: thousands of random policies walk for a moment. Those whose pendulum goes round are
   rare, and so are kept; of the others only the best. What is kept walks for longer, and is sorted
   into families of gaits.
2. **Race**: the best of every family evolve (CMA-ES: Hansen, The CMA evolution strategy: a
   tutorial, arXiv:1604.00772). Whoever does not walk in its family's gait after a short trial is
   out. Then there are two rounds: the best of each family, and the best of all.
3. **Refine**: the winner evolves on, with longer walks and with more starts in turn.

Two things change while a policy evolves. The price of distance follows its cost of transport
(`agents.pacing.paced_price`). And policies are judged by their best starts only, until they walk
from more: one that walks from one start in ten would else learn to stand, because it falls from the
other nine.

`campaign` is a generator: it asks for walks and is told what they are worth. It draws everything
random from its seed, so that the answers so far are all it takes to bring another one to the same
place.
"""

from __future__ import annotations

import numpy as np

from agents.evolution.asking import Among, NothingWalksError, Request, Search
from agents.evolution.contender import Contender, Schedule, Walking
from agents.evolution.screening import screen
from agents.evolution.settings import EvolutionSettings
from agents.evolution.walks import Duration
from agents.pacing import LEAST_SHARE
from trajopt.feedback.law import Floats


def campaign(
    settings: EvolutionSettings, seed: int, floor: float, start: Floats | None
) -> Search[None]:
    """The whole search; it never ends.

    Args:
        settings: how to search.
        seed: of everything random.
        floor: least price of distance.
        start: weights (SIZE,) to go on from instead of screening and racing.

    Raises:
        NothingWalksError: no random policy walks, or none of them still walks after the trial.
    """
    if start is not None:
        family = yield from _family_of(settings, seed, start)
        best = Contender(settings, family, start, (seed, 0), floor)
    else:
        best = yield from _raced(settings, seed, floor)
    yield from best.evolve("refine", None, refining(settings), None)


def racing(ask: EvolutionSettings) -> Schedule:
    """Short walks, all alike."""
    return Schedule((_walking(ask.starts, ask.intervals),), ask.looked_at)


def refining(ask: EvolutionSettings) -> Schedule:
    """Long walks from few starts and short ones from many, in turn.

    A long walk tells what the gait costs and whether it lasts. Most falls come while the pendulum
    is pumped up; few starts would hardly show them.
    """
    lasting = _walking(ask.refining_starts, ask.refining_intervals)
    setting_off = _walking(ask.setting_off_starts, ask.setting_off_intervals)
    return Schedule((lasting, setting_off), ask.refining_looked_at)


def _walking(starts: int, intervals: int) -> Walking:
    """Walks whose second half is judged."""
    return Walking(starts, Duration.judged_in_second_half(intervals))


def _raced(ask: EvolutionSettings, seed: int, floor: float) -> Search[Contender]:
    """Screen and race."""
    screened = yield from screen(ask, seed)
    walks = racing(ask)
    families: list[list[Contender]] = []
    leader: Contender | None = None
    for family, policies in screened.items():
        contenders: list[Contender] = []
        for k, policy in enumerate(policies):
            one = Contender(ask, family, policy, (seed, 3, family % 100, k), floor)
            yield from one.evolve(f"trial {one.name}", ask.trial, walks, leader)
            contenders.append(one)
            leader = one if leader is None or one.merit > leader.merit else leader
            if sum(each.gait.share >= LEAST_SHARE for each in contenders) == ask.finalists:
                break  # such a family is easy to find
        families.append(_ranked(contenders, ask.finalists))
    finalists = [one for ranked in families for one in ranked if one.merit > 0.0]
    if not finalists:
        raise NothingWalksError(
            f"none of the policies that walk among {ask.screened} random ones still walks after "
            f"{ask.trial} generations: try another seed, start from a policy's file (init), or "
            "screen more of them (EvolutionSettings.screened)"
        )
    for generations in (ask.race, 2 * ask.race):
        for one in finalists:
            [leader] = _ranked(finalists, 1)
            yield from one.evolve(f"race {one.name}", generations, walks, leader)
        finalists = _ranked(finalists, ask.finalists)
    return finalists[0]


def _ranked(contenders: list[Contender], most: int) -> list[Contender]:
    """The best of them, the best first."""
    return sorted(contenders, key=lambda one: -one.merit)[:most]


def _family_of(ask: EvolutionSettings, seed: int, start: Floats) -> Search[int]:
    """The family in which a policy earns most; 0 if it does not walk."""
    duration = Duration.judged_in_second_half(ask.intervals)
    asked = duration, Among.FAMILIES, 1.0, ask.first_price, start
    answer = yield Request("look", start[None], ask.looked_at, (seed, 2), *asked)
    if not len(answer.groups):
        return 0
    return int(answer.groups[np.argmax(answer.worth[:, 0])])
