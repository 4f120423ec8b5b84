"""A policy that evolves by itself: CMA-ES, a price that follows it, and judgement that widens."""

from __future__ import annotations

import cma
import numpy as np

from agents.evolution.asking import Request, Search
from agents.evolution.settings import LOOK_EVERY, EvolutionSettings
from agents.evolution.walks import Duration
from agents.evolution.worth import Gait
from agents.pacing import paced_price
from trajopt.feedback.law import Floats

#: Starts from which the mean policy is looked at.
LOOKED_AT = 64

#: The share of the starts by which policies are judged is this multiple of the share from which the
#: mean policy walks.
JUDGED_MULTIPLE = 2.0


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
        self.family, self.best, self.gait = family, weights, Gait(0.0, np.inf, 0.0)

    @property
    def name(self) -> str:
        """Its family, for people."""
        return f"{self.family:+d}"

    def evolve(
        self, stage: str, generations: int | None, starts: int, intervals: int, otherwise: Floats
    ) -> Search[None]:
        """Evolve for some generations, or for ever.

        Args:
            stage: for people.
            generations: None: for ever.
            starts: of every policy.
            intervals: of every walk.
            otherwise: the best policy so far, until this one walks.
        """
        least = self._settings.least_judged
        duration = Duration(intervals, intervals // 2)
        begun = self._generation
        while generations is None or self._generation < begun + generations:
            drawn = np.array(self._strategy.ask())
            shown = self.best if self.gait.share > 0.0 else otherwise
            judged = min(max(JUDGED_MULTIPLE * self._share, least), 1.0)
            asked = duration, self.family, judged, self._price, shown
            seed = (*self._seed, self._generation)
            answer = yield Request(stage, drawn, starts, seed, *asked)
            self._strategy.tell(list(drawn), list(-answer.worth[0]))
            self._generation += 1
            if self._generation % LOOK_EVERY == 0:
                mean, seed = np.array(self._strategy.mean), (self._seed[0], LOOKED_AT)
                answer = yield Request(stage, mean[None], LOOKED_AT, seed, *asked)
                self._share = answer.gait.share
                self._price = paced_price(self._price, answer.gait, self._floor)
                if merit(answer.gait) > merit(self.gait):
                    self.best, self.gait = mean, answer.gait


def merit(gait: Gait) -> float:
    """Larger is better: cheap walks, from many starts.

    One more start in a hundred that does not walk weighs as much as 4 % of the energy, which is
    about what it costs a cheap gait by the reward.
    """
    return -gait.cot / gait.share**4 if gait.share > 0.0 else -np.inf
