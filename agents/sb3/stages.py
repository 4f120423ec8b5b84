"""The stages in which PPO improves screened policies, and which policies go on to the next one."""

from __future__ import annotations

from typing import NamedTuple

from agents.pacing import CleanWalking


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
