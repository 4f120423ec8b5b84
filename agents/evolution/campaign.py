"""The search for a gait, from nothing: screen, race, refine.

1. **Screen**: thousands of random policies walk for a moment. Those whose pendulum goes round are
   rare, and so are kept; of the others only the best. What is kept walks for longer, and is sorted
   into families of gaits.
2. **Race**: the best of every family evolve (CMA-ES: Hansen, The CMA evolution strategy: a
   tutorial, arXiv:1604.00772). Whoever does not walk in its family's gait after a short trial is
   out. Then there are two rounds: the best of each family, and the best of all.
3. **Refine**: the winner evolves on, with longer walks.

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

from agents.evolution.asking import Among, Request, Search
from agents.evolution.contender import LOOKED_AT, Contender, merit
from agents.evolution.policy import SIZE
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
        RuntimeError: no random policy walks, or none of them still walks after the trial.
    """
    if start is not None:
        family = yield from _family_of(settings, seed, start)
        best = Contender(settings, family, start, (seed, 0), floor)
    else:
        best = yield from _raced(settings, seed, floor)
    walks = settings.refining_starts, settings.refining_intervals
    yield from best.evolve("refine", None, *walks, best.best)


def _raced(ask: EvolutionSettings, seed: int, floor: float) -> Search[Contender]:
    """Screen and race."""
    screened = yield from screen(ask, seed)
    families: list[list[Contender]] = []
    for family, policies in screened.items():
        contenders: list[Contender] = []
        for k, policy in enumerate(policies):
            contenders.append(Contender(ask, family, policy, (seed, 3, family % 100, k), floor))
            yield from _round("trial", contenders[-1:], ask.trial, ask)
            if sum(one.gait.share >= LEAST_SHARE for one in contenders) == ask.finalists:
                break  # such a family is easy to find
        families.append(_ranked(contenders)[: ask.finalists])
    finalists = [one for contenders in families for one in contenders]
    if not finalists:
        raise RuntimeError(
            f"none of the policies that walk among {ask.screened} random ones still walks after "
            f"{ask.trial} generations: screen more of them (screened), or start from a policy that "
            "walks (init)"
        )
    yield from _round("race", finalists, ask.race, ask)
    finalists = _ranked(finalists)[: ask.finalists]
    yield from _round("race", finalists, 2 * ask.race, ask)
    return _ranked(finalists)[0]


def _round(
    stage: str, contenders: list[Contender], generations: int, ask: EvolutionSettings
) -> Search[None]:
    """All of them evolve, one after the other."""
    for one in contenders:
        leading = _ranked(contenders)
        otherwise = leading[0].best if leading else np.zeros(SIZE)
        walks = ask.starts, ask.intervals
        yield from one.evolve(f"{stage} {one.name}", generations, *walks, otherwise)


def _ranked(contenders: list[Contender]) -> list[Contender]:
    """Those that walk, the best first."""
    walking = [one for one in contenders if one.gait.share > 0.0]
    return sorted(walking, key=lambda one: -merit(one.gait))


def _family_of(ask: EvolutionSettings, seed: int, start: Floats) -> Search[int]:
    """The family in which a policy earns most; 0 if it does not walk."""
    duration = Duration(ask.intervals, ask.intervals // 2)
    asked = duration, Among.FAMILIES, 1.0, ask.first_price, start
    answer = yield Request("look", start[None], LOOKED_AT, (seed, 2), *asked)
    if not len(answer.groups):
        return 0
    return int(answer.groups[np.argmax(answer.worth[:, 0])])
