"""Random policies, and which of them are worth evolving."""

from __future__ import annotations

import numpy as np

from agents.evolution.asking import Among, Answer, NothingWalksError, Request, Search
from agents.evolution.policy import SIZE
from agents.evolution.settings import EvolutionSettings
from agents.evolution.walks import Duration
from trajopt.feedback.law import Floats

#: Random weights are spread log-uniformly between these sizes; some of them are 0.
LEAST_WEIGHT, GREATEST_WEIGHT, PRESENT = 0.1, 0.5, 0.8


def random_policies(n: int, rng: np.random.Generator) -> Floats:
    """Weights (n, SIZE)."""
    sizes = np.exp(rng.uniform(np.log(LEAST_WEIGHT), np.log(GREATEST_WEIGHT), size=(n, SIZE)))
    return np.asarray(rng.normal(size=(n, SIZE)) * sizes * (rng.random((n, SIZE)) < PRESENT))


def screen(ask: EvolutionSettings, seed: int) -> Search[dict[int, Floats]]:
    """The best random policies (at most `contenders`, SIZE) of each family, the best first.

    Fewest turns of the pendulum first. A policy counts by its best start: hardly one walks from
    all of them.

    Raises:
        NothingWalksError: no random policy walks.
    """
    drawn = random_policies(ask.screened, np.random.default_rng((seed, 1)))
    glanced = yield _walks(ask, seed, drawn, ask.glance, Among.SENSES)
    drawn = drawn[np.unique(np.concatenate([*_best(glanced, ask.kept).values()]))]
    screened = yield _walks(ask, seed, drawn, ask.screen_intervals, Among.FAMILIES)
    if not len(screened.groups):
        raise NothingWalksError(
            f"none of {ask.screened} random policies walks on this machine: try another seed, "
            "start from a policy's file (init), or screen more of them (EvolutionSettings.screened)"
        )
    best = _best(screened, ask.contenders)
    return {family: drawn[some] for family, some in best.items()}


def _walks(
    ask: EvolutionSettings, seed: int, weights: Floats, intervals: int, among: Among
) -> Request:
    return Request(
        stage="screen",
        weights=weights,
        starts=ask.screen_starts,
        seed=(seed, 2),
        duration=Duration.judged_in_second_half(intervals),
        among=among,
        judged=1.0 / ask.screen_starts,
        price=ask.first_price,
        best=np.zeros(SIZE),
    )


def _best(answer: Answer, most: int) -> dict[int, Floats]:
    """Which policies are worth most in each group, at most `most`."""
    found = {}
    for group, worth in zip(answer.groups.astype(int).tolist(), answer.worth, strict=True):
        some = np.argsort(-worth, kind="stable")[:most]
        found[group] = some[np.isfinite(worth[some])]
    return found
