"""What makes one policy better than another."""

from __future__ import annotations

#: One more start in a hundred that does not walk weighs as much as 4 % of the energy, which is
#: about what it costs a cheap gait by the reward.
SURENESS = 4


def economy(share: float, cot: float) -> float:
    """Distance per energy of the starts that walk, times a power of their share; 0 without any.

    By reward alone, a policy that stands still would beat every walk that costs more than the price
    of distance, and a learner that has just begun to walk would leave its first policy as its best.
    By the share of starts alone, a walk at ten times the cost would beat one that misses a start.

    Args:
        share: of the starts, from which the policy walks.
        cot: cost of transport of these walks; anything if none walks.
    """
    return share**SURENESS / cot if share > 0.0 else 0.0
