"""The search for a gait, from nothing: screen, race, refine.

1. **Screen**: thousands of random policies walk from a few starts, and the best of every family of
   gaits once more from others: some were only lucky.
2. **Race**: the best few of every family evolve for a while (CMA-ES: Hansen, The CMA evolution
   strategy: a tutorial, arXiv:1604.00772). A family that is easy to find is not given more than one
   that is rare.
3. **Refine**: the one that walks cheapest evolves on, from more starts.

While a policy evolves, the price of distance follows its cost of transport
(`agents.pacing.paced_price`).

`campaign` is a generator: it asks for walks and is sent what they are worth. It draws everything
random from its seed, so that the answers so far are all it takes to bring another one to the same
place.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Generator
from typing import NamedTuple, TypeAlias

import cma
import numpy as np

from agents.evolution.policy import SIZE
from agents.evolution.walks import Duration
from agents.evolution.worth import Gait
from agents.pacing import paced_price
from agents.training import Settings
from trajopt.feedback.law import Floats

#: Starts, and generations between two looks at how the mean policy walks.
LOOKED_AT, LOOK_EVERY = 64, 10

#: Random weights are spread log-uniformly between these sizes; half of them are 0.
LEAST_WEIGHT, GREATEST_WEIGHT, PRESENT = 0.03, 1.0, 0.5


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvolutionSettings(Settings):
    """How evolution searches.

    Attributes:
        n_timesteps: control intervals in all; refining lasts until then.
        screened: random policies.
        screen_starts, screen_intervals: of each of them.
        rescreened: of each family, that walk again.
        rescreen_starts: from which they do.
        contenders: of each family in the race.
        race: generations of each contender.
        longer_race: more generations for the best contender of each family.
        population: policies of a generation.
        intervals: of a walk; its second half is judged.
        starts: of a policy in the race.
        refining_starts: of a policy afterwards.
        spread: standard deviation of the first generation, in root mean squares of the weights.
        first_price: price of distance at the beginning; far above the cost of clumsy walking.
        paid_speed: speed up to which distance is paid (m/s), so that no family is preferred
            because it runs.
    """

    n_timesteps: int = 1_500_000_000
    screened: int = 20_000
    screen_starts: int = 4
    screen_intervals: int = 600
    rescreened: int = 16
    rescreen_starts: int = 24
    contenders: int = 5
    race: int = 40
    longer_race: int = 80
    population: int = 24
    intervals: int = 800
    starts: int = 12
    refining_starts: int = 24
    spread: float = 0.3
    first_price: float = 5.0
    paid_speed: float = 0.6


class Request(NamedTuple):
    """Walks that a campaign asks for.

    Attributes:
        stage: for people.
        weights: of the policies, (P, SIZE).
        starts: how many.
        seed: of the starts.
        duration: of the walks.
        family: for which they are paid; None: for every family in which one walks.
        price: of distance.
        best: the best policy so far, (SIZE,); zeros do nothing.
    """

    stage: str
    weights: Floats
    starts: int
    seed: tuple[int, ...]
    duration: Duration
    family: int | None
    price: float
    best: Floats


class Answer(NamedTuple):
    """What a campaign is sent.

    Attributes:
        families: in which some policy walks, or the one that was asked for, (F,).
        worth: of the policies in each of them, (F, P). Where no family was asked for, it is -inf
            for a policy that does not walk in this one.
        gait: how the first policy walks in the first family, if there is any.
    """

    families: Floats
    worth: Floats
    gait: Gait


Campaign: TypeAlias = Generator[Request, Answer, None]


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
        self._family, self._price, self._generation = family, settings.first_price, 0
        self.best, self.gait = weights, Gait(0.0, np.inf, 0.0)

    def evolve(
        self, stage: str, generations: int | None, starts: int, otherwise: Floats
    ) -> Campaign:
        """Evolve for some generations, or for ever.

        Args:
            stage: for people.
            generations: None: for ever.
            starts: of every policy.
            otherwise: the best policy so far, until this one walks.
        """
        ask = self._settings
        duration = Duration(ask.intervals, ask.intervals // 2)
        begun = self._generation
        while generations is None or self._generation < begun + generations:
            drawn = np.array(self._strategy.ask())
            shown = self.best if self.gait.share > 0.0 else otherwise
            asked = duration, self._family, self._price, shown
            seed = (*self._seed, self._generation)
            answer = yield Request(stage, drawn, starts, seed, *asked)
            self._strategy.tell(list(drawn), list(-answer.worth[0]))
            self._generation += 1
            if self._generation % LOOK_EVERY == 0:
                mean, seed = np.array(self._strategy.mean), (self._seed[0], LOOKED_AT)
                answer = yield Request(stage, mean[None], LOOKED_AT, seed, *asked)
                self._price = paced_price(self._price, answer.gait, self._floor)
                if merit(answer.gait) > merit(self.gait):
                    self.best, self.gait = mean, answer.gait


def merit(gait: Gait) -> float:
    """Larger is better: cheap walks, from many starts."""
    return -gait.cot / gait.share**0.5 if gait.share > 0.0 else -np.inf


def random_policies(n: int, rng: np.random.Generator) -> Floats:
    """Weights (n, SIZE)."""
    sizes = np.exp(rng.uniform(np.log(LEAST_WEIGHT), np.log(GREATEST_WEIGHT), size=(n, SIZE)))
    return np.asarray(rng.normal(size=(n, SIZE)) * sizes * (rng.random((n, SIZE)) < PRESENT))


def campaign(
    settings: EvolutionSettings, seed: int, floor: float, start: Floats | None
) -> Campaign:
    """The whole search; it never ends.

    Args:
        settings: how to search.
        seed: of everything random.
        floor: least price of distance.
        start: weights (SIZE,) to go on from instead of screening and racing.

    Raises:
        RuntimeError: no random policy walks.
    """
    if start is not None:
        family = yield from _family_of(settings, seed, start)
        best = Contender(settings, family, start, (seed, 0), floor)
    else:
        best = yield from _found(settings, seed, floor)
    yield from best.evolve("refine", None, settings.refining_starts, best.best)


def _found(
    ask: EvolutionSettings, seed: int, floor: float
) -> Generator[Request, Answer, Contender]:
    """Screen and race."""
    nothing = np.zeros(SIZE)
    drawn = random_policies(ask.screened, np.random.default_rng((seed, 1)))
    duration = Duration(ask.screen_intervals, ask.screen_intervals // 2)
    asked = duration, None, ask.first_price, nothing
    screened = yield Request("screen", drawn, ask.screen_starts, (seed, 2), *asked)
    if not len(screened.families):
        raise RuntimeError(
            f"none of {ask.screened} random policies walks on this machine: screen more of them "
            "(screened), or start from a policy that walks (init)"
        )
    best: Contender | None = None
    for family, worth in zip(screened.families.astype(int).tolist(), screened.worth, strict=True):
        some = np.argsort(-worth)[: ask.rescreened]
        some = some[np.isfinite(worth[some])]
        asked_again = duration, family, ask.first_price, nothing if best is None else best.best
        again = yield Request("screen", drawn[some], ask.rescreen_starts, (seed, 4), *asked_again)
        contenders = []
        for k, i in enumerate(some[np.argsort(-again.worth[0])][: ask.contenders]):
            one = Contender(ask, family, drawn[i], (seed, 3, family % 100, k), floor)
            yield from one.evolve(f"race {family:+d}", ask.race, ask.starts, asked_again[-1])
            contenders.append(one)
        first = max(contenders, key=lambda one: merit(one.gait))
        yield from first.evolve(f"race {family:+d}", ask.longer_race, ask.starts, first.best)
        if best is None or merit(first.gait) > merit(best.gait):
            best = first
    assert best is not None
    return best


def _family_of(ask: EvolutionSettings, seed: int, start: Floats) -> Generator[Request, Answer, int]:
    """The family in which a policy earns most; 0 if it does not walk."""
    duration = Duration(ask.intervals, ask.intervals // 2)
    asked = duration, None, ask.first_price, start
    answer = yield Request("look", start[None], LOOKED_AT, (seed, 2), *asked)
    if not len(answer.families):
        return 0
    return int(answer.families[np.argmax(answer.worth[:, 0])])
