"""The search for a gait, from nothing: screen, race, refine.

1. **Screen**: thousands of random policies walk for a moment. Those whose pendulum goes round are
   rare, and so are retained; of the others only the best. The retained ones walk for longer, and
   are sorted into families of gaits.
2. **Race**: the best of every family evolve (CMA-ES: Hansen, The CMA evolution strategy: a
   tutorial, arXiv:1604.00772). A candidate that does not walk in its family's gait after a short
   trial is out. Then there are two rounds: the best of each family, and the best of all.
3. **Refine**: the winner evolves on, with longer walks and with more starts in turn.

Two things change while a policy evolves. The reward weight of distance follows its cost of
transport (`agents.reward_weight.adapted_weight`). And only the best starts of a policy count, until
it walks from more: one that walks from one start in ten would else learn to stand, because it falls
from the other nine.

`search` is a generator: it yields the walks that it needs and is sent their scores. It draws
everything random from its seed, so that the answers so far are all it takes to bring another one to
the same place.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Generator
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from agents.evolution.walks import (
    SIZE,
    Duration,
    PolicySimulator,
    PolicyWalks,
    WalkReward,
    families,
    members,
    senses,
)
from agents.learner import DoesNotWalkError, LearnerSettings
from agents.reward_weight import LEAST_SHARE, NO_WALK, CleanWalking, adapted_weight, economy
from agents.rollout import draw_starts
from rimless_gym.checks import extra, integer, positive
from trajopt.feedback.law import Floats

#: Generations between two checks of how the mean policy walks.
CHECK_EVERY = 10

#: The starts of all checks are those of this seed beside the search's own.
CHECK_SEED = 64

#: The share of the starts that counts is this multiple of the share from which the mean policy
#: walks.
COUNTED_MULTIPLE = 2.0

#: Random weights are spread log-uniformly between these sizes; some of them are 0.
LEAST_WEIGHT, GREATEST_WEIGHT, PRESENT = 0.1, 0.5, 0.8


#: How policies are sorted, other than by one family of gaits: by the sense in which the pendulum
#: goes round at the end, -1, 1, or 0 if it does not; or by every family in which one of them walks.
SENSES, FAMILIES = "senses", "families"


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvolutionSettings(LearnerSettings):
    """How evolution searches.

    Attributes:
        n_timesteps: control intervals in all; refining lasts until then.
        screened: random policies.
        screen_starts: of each of them.
        glance: intervals of their first, short walk.
        retained: most policies of one sense of rotation that walk for longer.
        screen_intervals: of the longer walk.
        candidates: most of each family in the trial.
        trial: generations of each candidate; those that do not walk then are out.
        finalists: of each family after the trial; and of all families after the first round.
        race: generations of the first round; the second has twice as many.
        population: policies of a generation.
        intervals: of a walk in the race; its second half is measured.
        starts: of a policy in the race.
        refining_intervals: of a walk afterwards. Some policies fall after half a minute, and in
            short walks what is left of the start-up hides the cost of the gait.
        refining_starts: of a policy afterwards, in every other generation.
        start_up_intervals: of a walk in the generations between: to get going, and little more.
        start_up_starts: of a policy in these.
        checked_starts: from which the mean policy is checked during the race.
        refining_checked_starts: the same afterwards. The best of many checks is retained; from few
            starts that would be the luckiest one.
        least_counted: share of the starts that counts while a policy walks from few; 1 for always
            all of them.
        spread: standard deviation of the first generation, in root mean squares of the weights.
        first_weight: reward weight of distance at first; far above the cost of clumsy walking.
        rewarded_speed: speed up to which distance is rewarded (m/s), so that no family is preferred
            because it runs.

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: a number is out of its range.
    """

    n_timesteps: int = 600_000_000
    screened: int = 50_000
    screen_starts: int = 4
    glance: int = 200
    retained: int = 1500
    screen_intervals: int = 600
    candidates: int = 12
    trial: int = 10
    finalists: int = 3
    race: int = 30
    population: int = 24
    intervals: int = 800
    starts: int = 24
    refining_intervals: int = 5000
    refining_starts: int = 12
    start_up_intervals: int = 1000
    start_up_starts: int = 60
    checked_starts: int = 64
    refining_checked_starts: int = 256
    least_counted: float = 0.1
    spread: float = 0.3
    first_weight: float = 5.0
    rewarded_speed: float = 0.6

    def __post_init__(self) -> None:
        least = {"trial": CHECK_EVERY, "glance": 2}  # half of a walk is measured
        least |= {f.name: 2 for f in dataclasses.fields(self) if f.name.endswith("intervals")}
        for field in dataclasses.fields(self):
            if isinstance(field.default, int):
                integer(field.name, getattr(self, field.name), least.get(field.name, 1))
            else:
                positive(field.name, getattr(self, field.name))


class Request(NamedTuple):
    """Walks that a search needs."""

    weights: Floats  # of the policies, (P, SIZE)
    starts: int  # how many
    seed: tuple[int, ...]  # of the starts
    duration: Duration  # of the walks
    groups: int | str  # the family whose gait is rewarded, or `SENSES` or `FAMILIES`
    counted: float  # share of the starts that counts: each policy's best ones
    distance_weight: float  # in the reward
    best: Floats  # the best policy so far, (SIZE,); zeros do nothing


class Answer(NamedTuple):
    """What a search is sent."""

    # the senses or families in which some policy walks, or the requested family, (G,)
    groups: Floats
    # of the policies in each of them, (G, P). Where groups are distinguished, it is -inf outside
    scores: Floats
    gait: CleanWalking  # how the first policy walks in the first group, if there is any


_Result = TypeVar("_Result")

#: A part of a search, which yields requests and returns a result.
Search: TypeAlias = Generator[Request, Answer, _Result]


def answered(request: Request, simulator: PolicySimulator, objective: WalkReward) -> Answer:
    """Simulate the policies of a request, and score them as requested."""
    starts = draw_starts(simulator.params, request.starts, request.seed)
    walks = simulator.walk(request.weights, starts, request.duration)
    groups, belongs = _groups(request.groups, walks)
    scores = np.empty((len(groups), len(request.weights)))
    for k, group in enumerate(groups):
        scores[k] = objective.scores(
            walks, request.duration, group, request.distance_weight, request.counted
        )
        scores[k, ~belongs[k]] = -np.inf
    gait = objective.gait(walks, request.duration, groups[0]) if len(groups) else NO_WALK
    return Answer(groups.astype(np.float64), scores, gait)


def _groups(groups: int | str, walks: PolicyWalks) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The groups (G,) into which policies are sorted, and which belong to each of them, (G, P)."""
    if groups is SENSES:
        each = np.array([0, -1, 1])
        return each, np.array([(senses(walks) == sense).any(axis=1) for sense in each])
    if groups is FAMILIES:
        each = families(walks)
        belongs = [members(walks, family).any(axis=1) for family in each]
        return each, np.array(belongs, dtype=bool).reshape(len(each), len(walks.steps))
    return np.array([groups]), np.ones((1, len(walks.steps)), dtype=bool)


def search(
    settings: EvolutionSettings, seed: int, floor: float, start: Floats | None
) -> Search[None]:
    """The whole search; it never ends. `start` (SIZE,) takes the place of screening and racing.

    Raises:
        ValueError: no random policy walks, or none of them still walks after the trial.
    """
    if start is not None:
        family = yield from _family_of(settings, seed, start)
        best = EvolvingPolicy(settings, family, start, (seed, 0), floor)
    else:
        best = yield from _race(settings, seed, floor)
    # A long walk shows what the gait costs and whether it lasts. Most falls happen while the
    # pendulum is pumped up; few starts would hardly show them.
    refining = (
        Generation(settings.refining_starts, Duration.second_half(settings.refining_intervals)),
        Generation(settings.start_up_starts, Duration.second_half(settings.start_up_intervals)),
    )
    yield from best.evolve(None, refining, settings.refining_checked_starts, None)


def screen(settings: EvolutionSettings, seed: int) -> Search[dict[int, Floats]]:
    """The best random policies (at most `candidates`, SIZE) of each family, the best first.

    Fewest revolutions of the pendulum first. A policy counts by its best start: hardly one walks
    from all of them.
    """
    drawn = random_policies(settings.screened, np.random.default_rng((seed, 1)))

    def request(weights: Floats, intervals: int, groups: str) -> Request:
        return Request(
            weights=weights,
            starts=settings.screen_starts,
            seed=(seed, 2),
            duration=Duration.second_half(intervals),
            groups=groups,
            counted=1.0 / settings.screen_starts,
            distance_weight=settings.first_weight,
            best=np.zeros(SIZE),
        )

    glanced = yield request(drawn, settings.glance, SENSES)
    drawn = drawn[np.unique(np.concatenate([*_best(glanced, settings.retained).values()]))]
    screened = yield request(drawn, settings.screen_intervals, FAMILIES)
    if not len(screened.groups):
        raise DoesNotWalkError(
            f"screened = {settings.screened}: none of so many random policies walks with these "
            "parameters; try another seed, start from a policy's file (init), or screen more of "
            "them (--settings screened=200000)"
        )
    best = _best(screened, settings.candidates)
    return {family: drawn[some] for family, some in best.items()}


def random_policies(n: int, rng: np.random.Generator) -> Floats:
    """Weights (n, SIZE)."""
    sizes = np.exp(rng.uniform(np.log(LEAST_WEIGHT), np.log(GREATEST_WEIGHT), size=(n, SIZE)))
    return np.asarray(rng.normal(size=(n, SIZE)) * sizes * (rng.random((n, SIZE)) < PRESENT))


def _best(answer: Answer, most: int) -> dict[int, Floats]:
    """Which policies have the highest scores in each group, at most `most`."""
    best = {}
    for group, scores in zip(answer.groups.astype(int).tolist(), answer.scores, strict=True):
        some = np.argsort(-scores, kind="stable")[:most]
        best[group] = some[np.isfinite(scores[some])]
    return best


def _race(settings: EvolutionSettings, seed: int, floor: float) -> Search[EvolvingPolicy]:
    """Screen and race."""
    screened = yield from screen(settings, seed)
    schedule = (Generation(settings.starts, Duration.second_half(settings.intervals)),)
    checked = settings.checked_starts
    ranked: list[EvolvingPolicy] = []
    leader: EvolvingPolicy | None = None
    for family, policies in screened.items():
        candidates: list[EvolvingPolicy] = []
        for k, policy in enumerate(policies):
            one = EvolvingPolicy(settings, family, policy, (seed, 3, family % 100, k), floor)
            yield from one.evolve(settings.trial, schedule, checked, leader)
            candidates.append(one)
            leader = one if leader is None or one.score > leader.score else leader
            if sum(each.gait.share >= LEAST_SHARE for each in candidates) == settings.finalists:
                break  # such a family is easy to find
        ranked += _ranked(candidates, settings.finalists)
    finalists = [one for one in ranked if one.score > 0.0]
    if not finalists:
        raise DoesNotWalkError(
            f"none of the policies that walk among {settings.screened} random ones still walks "
            f"after {settings.trial} generations: try another seed, start from a policy's file "
            "(init), or screen more of them (--settings screened=200000)"
        )
    for generations in (settings.race, 2 * settings.race):
        for one in finalists:
            [leader] = _ranked(finalists, 1)
            yield from one.evolve(generations, schedule, checked, leader)
        finalists = _ranked(finalists, settings.finalists)
    return finalists[0]


def _family_of(settings: EvolutionSettings, seed: int, start: Floats) -> Search[int]:
    """The family in which a policy has the highest score; 0 if it does not walk."""
    answer = yield Request(
        weights=start[None],
        starts=settings.checked_starts,
        seed=(seed, 2),
        duration=Duration.second_half(settings.intervals),
        groups=FAMILIES,
        counted=1.0,
        distance_weight=settings.first_weight,
        best=start,
    )
    if not len(answer.groups):
        return 0
    return int(answer.groups[np.argmax(answer.scores[:, 0])])


class Generation(NamedTuple):
    """How the policies of a generation walk: starts of each policy, and duration of each walk."""

    starts: int
    duration: Duration


class EvolvingPolicy:
    """A policy that evolves: CMA-ES, with an adaptive reward weight, and more and more starts.

    Attributes:
        family: of its gait.
        best: the best of the mean policies that were checked; the first one before that.
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
        self._distance_weight, self._generation, self._share = settings.first_weight, 0, 0.0
        self._check = Generation(0, Duration(0, 0))
        self.family, self.best, self.gait = family, weights, NO_WALK

    @property
    def score(self) -> float:
        """Score of the best policy. Larger is better; 0 if it does not walk."""
        return economy(self.gait.share, self.gait.cot)

    def evolve(
        self,
        generations: int | None,
        schedule: tuple[Generation, ...],
        checked_starts: int,
        leader: EvolvingPolicy | None,
    ) -> Search[None]:
        """Evolve for some generations, or for ever, with the walks of `schedule` in turn.

        The mean policy is checked from `checked_starts`, in walks as long as the first's. The
        leader's best policy is the best so far, as long as this one's is not.
        """
        least = self._settings.least_counted
        check = Generation(checked_starts, schedule[0].duration)
        if self.gait.share > 0.0 and check != self._check:
            answer = yield self._request(self.best[None], check, leader)
            self.gait = answer.gait  # in longer walks it may fall
        self._check, first = check, self._generation
        while generations is None or self._generation < first + generations:
            drawn = np.array(self._strategy.ask())
            walks = schedule[self._generation % len(schedule)]
            answer = yield self._request(drawn, walks, leader)._replace(
                seed=(*self._seed, self._generation),
                counted=min(max(COUNTED_MULTIPLE * self._share, least), 1.0),
            )
            self._strategy.tell(list(drawn), list(-answer.scores[0]))
            self._generation += 1
            if self._generation % CHECK_EVERY == 0:
                mean = np.array(self._strategy.mean)
                answer = yield self._request(mean[None], check, leader)
                self._share = answer.gait.share
                self._distance_weight = adapted_weight(
                    self._distance_weight, answer.gait, self._floor
                )
                if economy(answer.gait.share, answer.gait.cot) > self.score:
                    self.best, self.gait = mean, answer.gait

    def _request(
        self, weights: Floats, walks: Generation, leader: EvolvingPolicy | None
    ) -> Request:
        """Walks of some policies from the starts of every check."""
        best = leader if leader is not None and leader.score > self.score else self
        return Request(
            weights=weights,
            starts=walks.starts,
            seed=(self._seed[0], CHECK_SEED),
            duration=walks.duration,
            groups=self.family,
            counted=1.0,
            distance_weight=self._distance_weight,
            best=best.best,
        )


def _ranked(candidates: list[EvolvingPolicy], most: int) -> list[EvolvingPolicy]:
    """The best of them, the best first."""
    return sorted(candidates, key=lambda one: -one.score)[:most]
