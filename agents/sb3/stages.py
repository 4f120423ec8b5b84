"""The stages in which PPO improves screened policies, and which policies go on to the next one."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.pacing import CleanWalking
from trajopt.feedback.law import Floats


class Stage(NamedTuple):
    """How PPO improves each contender, for some time, before they are compared.

    Attributes:
        steps: time steps; None: all that are left.
        critic_first: roll-outs at the beginning in which only the critic learns. A critic that has
            only begun to learn spoils a good policy within a minute.
        noise: standard deviations at first and in the end, in units of the limit. To leave dear
            gaits takes more noise than cheap ones stand; and what pays best under noise is not what
            pays best without, so noise that stays stops the descent.
        last_rate: to what share of itself the learning rate falls.
        finalists: contenders that go on to the next stage, at most `OF_A_FAMILY` of each family.
    """

    steps: int | None
    critic_first: int
    noise: tuple[float, float]
    last_rate: float
    finalists: int


#: A trial of all contenders, two heats of the best, and the best of all settles.
STAGES = (
    Stage(1_000_000, 4, (0.1, 0.1), 1.0, finalists=5),
    Stage(2_000_000, 8, (0.1, 0.1), 1.0, finalists=2),
    Stage(5_000_000, 8, (0.1, 0.06), 1.0, finalists=1),
    Stage(None, 12, (0.06, 0.02), 0.2, finalists=0),
)

#: Contenders of one family that may go on to the next stage.
OF_A_FAMILY = 2

#: The share of starts that must walk before the price falls, while contenders are compared. The
#: price of a policy that rests or falls from some starts would stay high otherwise, and its gait
#: dear. What it lacks is mended when it settles.
RACING_SHARE = 0.5


def promise(gait: CleanWalking) -> float:
    """Distance per energy, times the share of starts that walk.

    A share counts for less than in `agents.scores.economy`, because falls and rests are mended
    later. With that score the slowest whirlers would win: they walk surely, but only lean in the
    end.
    """
    return gait.share / gait.cot


def best_of(promises: list[float], families: list[int], most: int) -> list[int]:
    """The contenders that promise most, the best first, at most `OF_A_FAMILY` of each family."""
    found: list[int] = []
    for k in sorted(range(len(promises)), key=lambda k: -promises[k]):
        others = [families[i] for i in found]
        if others.count(families[k]) < OF_A_FAMILY:
            found.append(k)
    return found[:most]


@dataclasses.dataclass
class Contest:
    """Policies whose turn comes one after the other, stage after stage, until one is left.

    Attributes:
        contenders: weights of the stage's policies, (n, size). A policy is replaced by what it has
            become when its turn is over.
        families: of their gaits, (n,).
        stage: index of the stage.
        gaits: of the contenders whose turn is over.
    """

    contenders: Floats
    families: NDArray[np.int64]
    stage: int = 0
    gaits: list[CleanWalking] = dataclasses.field(default_factory=list)

    @classmethod
    def settling(cls, weights: Floats) -> Contest:
        """One in which a single policy (size,) is left."""
        return cls(weights[None], np.zeros(1, dtype=np.int64), len(STAGES) - 1)

    @property
    def rules(self) -> Stage:
        """How its policies are improved in this stage."""
        return STAGES[self.stage]

    @property
    def settles(self) -> bool:
        """Whether one contender is left, which learns to the end."""
        return self.rules.steps is None

    @property
    def contender(self) -> Floats:
        """Weights of the policy whose turn it is, (size,)."""
        return self.contenders[len(self.gaits)]

    def end_turn(self, weights: Floats, gait: CleanWalking) -> None:
        """Note what the policy has become and how it walks; the next turn or stage begins."""
        self.contenders[len(self.gaits)] = weights
        self.gaits.append(gait)
        if len(self.gaits) < len(self.contenders):
            return
        best = best_of(
            [promise(each) for each in self.gaits], self.families.tolist(), self.rules.finalists
        )
        self.contenders, self.families = self.contenders[best], self.families[best]
        self.stage, self.gaits = self.stage + 1, []

    def state(self) -> dict[str, Any]:
        """Plain values and arrays, from which `read` makes the same contest."""
        gaits = np.array(self.gaits).reshape(-1, len(CleanWalking._fields))
        return dataclasses.asdict(self) | {"gaits": gaits}

    @classmethod
    def read(cls, state: Mapping[str, Any]) -> Contest:
        """The contest of a `state`."""
        gaits = [CleanWalking(*gait) for gait in state["gaits"].tolist()]
        return cls(state["contenders"], state["families"], int(state["stage"]), gaits)
