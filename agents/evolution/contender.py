"""A policy that evolves by itself: CMA-ES, a price that follows it, and judgement that widens."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from agents.evolution.asking import Request, Search
from agents.evolution.settings import LOOK_EVERY, EvolutionSettings
from agents.evolution.walks import Duration
from agents.pacing import NO_WALK, paced_price
from agents.scores import economy
from rimless_gym.checks import extra
from trajopt.feedback.law import Floats

#: The starts of all looks are those of this seed beside the search's own.
LOOK_SEED = 64

#: The share of the starts by which policies are judged is this multiple of the share from which the
#: mean policy walks.
JUDGED_MULTIPLE = 2.0


class Walking(NamedTuple):
    """How the policies of a generation walk.

    Attributes:
        starts: of each policy.
        duration: of each walk.
    """

    starts: int
    duration: Duration


class Schedule(NamedTuple):
    """How policies walk while they evolve.

    Attributes:
        turns: generations walk in these ways, one after the other.
        looked_at: starts from which the mean policy is looked at, in walks as long as the first's.
    """

    turns: tuple[Walking, ...]
    looked_at: int


class Contender:
    """A policy that evolves.

    Args:
        settings: how.
        family: of its gait.
        weights: of the first policy, (SIZE,).
        seed: of the evolution.
        floor: least price of distance.

    Attributes:
        best: the best of the mean policies that were looked at; the first one before that.
        gait: how it walked.
    """

    def __init__(
        self,
        settings: EvolutionSettings,
        family: int,
        weights: Floats,
        seed: tuple[int, ...],
        floor: float,
    ) -> None:
        with extra("learn"):  # here: a policy that has evolved walks without it
            import cma
        rng = np.random.default_rng(seed)
        options = {
            "popsize": settings.population,
            "randn": lambda *shape: rng.standard_normal(shape),
            "seed": np.nan,  # numpy's global generator stays as it is
            "verbose": -9,
        }
        spread = settings.spread * float(np.sqrt(np.mean(weights**2)))
        self._strategy = cma.CMAEvolutionStrategy(weights, spread, options)
        self._settings, self._seed, self._floor = settings, seed, floor
        self._price, self._generation, self._share = settings.first_price, 0, 0.0
        self._look = Walking(0, Duration(0, 0))
        self.family, self.best, self.gait = family, weights, NO_WALK

    @property
    def name(self) -> str:
        """Its family, for people."""
        return f"{self.family:+d}"

    @property
    def merit(self) -> float:
        """Merit of the best policy. Larger is better; 0 if it does not walk."""
        return economy(self.gait.share, self.gait.cot)

    def evolve(
        self, stage: str, generations: int | None, walks: Schedule, leader: Contender | None
    ) -> Search[None]:
        """Evolve for some generations, or for ever.

        Args:
            stage: for people.
            generations: None: for ever.
            walks: of every policy.
            leader: whose best policy is the best so far, as long as this one's is not.
        """
        least, look = self._settings.least_judged, Walking(walks.looked_at, walks.turns[0].duration)
        if self.gait.share > 0.0 and look != self._look:
            answer = yield self._request(stage, self.best[None], look, leader)
            self.gait = answer.gait  # in longer walks it may fall
        self._look, begun = look, self._generation
        while generations is None or self._generation < begun + generations:
            drawn = np.array(self._strategy.ask())
            turn = walks.turns[self._generation % len(walks.turns)]
            answer = yield self._request(stage, drawn, turn, leader)._replace(
                seed=(*self._seed, self._generation),
                judged=min(max(JUDGED_MULTIPLE * self._share, least), 1.0),
            )
            self._strategy.tell(list(drawn), list(-answer.worth[0]))
            self._generation += 1
            if self._generation % LOOK_EVERY == 0:
                mean = np.array(self._strategy.mean)
                answer = yield self._request(stage, mean[None], look, leader)
                self._share = answer.gait.share
                self._price = paced_price(self._price, answer.gait, self._floor)
                if economy(answer.gait.share, answer.gait.cot) > self.merit:
                    self.best, self.gait = mean, answer.gait

    def _request(
        self, stage: str, weights: Floats, walks: Walking, leader: Contender | None
    ) -> Request:
        """Walks of some policies from the starts of every look."""
        best = leader if leader is not None and leader.merit > self.merit else self
        return Request(
            stage=stage,
            weights=weights,
            starts=walks.starts,
            seed=(self._seed[0], LOOK_SEED),
            duration=walks.duration,
            among=self.family,
            judged=1.0,
            price=self._price,
            best=best.best,
        )
