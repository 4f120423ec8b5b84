"""What a search asks for, and what it is told."""

from __future__ import annotations

import enum
from collections.abc import Generator
from typing import NamedTuple, TypeAlias, TypeVar

from agents.evolution.walks import Duration
from agents.pacing import CleanWalking
from trajopt.feedback.law import Floats


class NothingWalksError(ValueError):
    """The search has found no policy to go on from."""


class Among(enum.Enum):
    """How policies are told apart, other than by one family of gaits."""

    #: By the sense in which the pendulum goes round at the end: -1, 1, or 0 if it does not.
    SENSES = "senses"
    #: By every family in which one of them walks.
    FAMILIES = "families"


class Request(NamedTuple):
    """Walks that a search asks for.

    Attributes:
        stage: for people.
        weights: of the policies, (P, SIZE).
        starts: how many.
        seed: of the starts.
        duration: of the walks.
        among: the family for which they are paid, or how they are told apart.
        judged: share of the starts that counts: each policy's best ones.
        price: of distance.
        best: the best policy so far, (SIZE,); zeros do nothing.
    """

    stage: str
    weights: Floats
    starts: int
    seed: tuple[int, ...]
    duration: Duration
    among: int | Among
    judged: float
    price: float
    best: Floats


class Answer(NamedTuple):
    """What a search is told.

    Attributes:
        groups: the senses or families in which some policy walks, or the family asked for, (G,).
        worth: of the policies in each of them, (G, P). Where policies are told apart, it is -inf
            for those that do not belong to the group.
        gait: how the first policy walks in the first group, if there is any.
    """

    groups: Floats
    worth: Floats
    gait: CleanWalking


_Found = TypeVar("_Found")

#: A part of a search, which asks and at its end has found something.
Search: TypeAlias = Generator[Request, Answer, _Found]
