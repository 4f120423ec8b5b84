"""The adaptive reward weight of distance, and the score by which policies are compared.

With the true weight, standing still is the best that an untrained policy can do. With a high one
walking is rewarded at once, but so is running, and little is gained by walking efficiently. So the
weight begins high and falls with the policy's own cost of transport, to a multiple of it: walking
is always rewarded, and so is walking at a lower cost. Lowered faster than that, it may make
policies rest, or fall on purpose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

#: The weight is this multiple of the cost of transport.
MULTIPLE = 2.0

#: Share of starts that must walk before the weight falls.
LEAST_SHARE = 0.3

#: Fewest steps in the window of a wheel that walks.
FEWEST_STEPS = 3

#: One more start in a hundred that does not walk weighs as much as 4 % of the energy.
SHARE_EXPONENT = 4


class CleanWalking(NamedTuple):
    """How a policy walks without exploration."""

    share: float  # of the starts, from which it walks by the rules
    cot: float  # cost of transport of these walks; infinite without any
    speed: float  # of these walks (m/s); 0 without any


#: That of a policy which walks from no start.
NO_WALK = CleanWalking(0.0, math.inf, 0.0)


def adapted_weight(weight: float, walking: CleanWalking, floor: float) -> float:
    """The next weight of distance; it never rises, and never falls below `floor`, the true weight.

    It becomes `MULTIPLE` times the policy's cost of transport without exploration, once
    `LEAST_SHARE` of the starts walk.
    """
    if walking.share < LEAST_SHARE or not math.isfinite(walking.cot):
        return weight
    return min(weight, max(MULTIPLE * walking.cot, floor))


def economy(share: float, cot: float, exponent: int = SHARE_EXPONENT) -> float:
    """Distance per energy of the starts that walk, times a power of their share; 0 without any.

    By reward alone, a policy that stands still would beat every walk that costs more than the
    reward weight of distance, and a learner that has just begun to walk would leave its first
    policy as its best. By the share of starts alone, a walk at ten times the cost would beat one
    that misses a start.

    Args:
        share: of the starts, from which the policy walks.
        cot: cost of transport of these walks; anything if none walks.
        exponent: of the share.
    """
    return share**exponent / cot if share > 0.0 else 0.0
