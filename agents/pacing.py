"""The self-paced price of distance: it follows what the learner's own walking costs.

At the true price, standing still is the best that an untrained policy can do. At a high one walking
pays at once, but so does running, and little is gained by walking cheaply. So the price begins high
and falls with the policy's own cost of transport, to a multiple of it: walking always pays, and so
does walking cheaper. Lowered faster than that, it may make policies rest, or fall on purpose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

#: The price is this multiple of the cost of transport, if nothing else is said.
MULTIPLE = 2.0

#: Share of starts that must walk before the price falls.
LEAST_SHARE = 0.3


#: Fewest steps in the window of a wheel that walks.
FEWEST_STEPS = 3


class CleanWalking(NamedTuple):
    """How a policy walks without exploration.

    Attributes:
        share: of the starts, from which it walks by the rules.
        cot: cost of transport of these walks; infinite without any.
        speed: of these walks (m/s); 0 without any.
    """

    share: float
    cot: float
    speed: float


#: That of a policy which walks from no start.
NO_WALK = CleanWalking(0.0, math.inf, 0.0)


def paced_price(
    price: float,
    walking: CleanWalking,
    floor: float,
    least_share: float = LEAST_SHARE,
    multiple: float = MULTIPLE,
    margin: float = math.inf,
) -> float:
    """The next price of distance.

    Args:
        price: the last one; the price never rises.
        walking: how the policy walks, without exploration.
        floor: the true price, below which it never falls.
        least_share: of starts that must walk before it falls.
        multiple: of the cost of transport, which the price becomes.
        margin: the most that the price exceeds the cost of transport.
    """
    if walking.share < least_share or not math.isfinite(walking.cot):
        return price
    aimed = min(multiple * walking.cot, walking.cot + margin)
    return min(price, max(aimed, floor))
