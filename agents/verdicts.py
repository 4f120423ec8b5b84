"""Which of a policy's starts count as walking, and why the others do not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from agents.window import Window
from rimless_gym.rules import VIOLATIONS, violations

#: What may be said of a start: it walks; it falls; it takes no steps at the end; or its walk breaks
#: a rule, of which the first in the order of `rimless_gym.rules.VIOLATIONS` is named.
WALKS, FALLS, STOPS = "walks", "falls", "stops"
VERDICTS = (WALKS, FALLS, STOPS, *VIOLATIONS)


def verdicts(
    fallen: NDArray[np.bool_], stepping: NDArray[np.bool_], window: Window
) -> tuple[str, ...]:
    """The verdict on each start, one of `VERDICTS`, N of them.

    Args:
        fallen: of each start, (N,).
        stepping: whether it still takes steps at the end, (N,).
        window: of the walks.
    """
    found = []
    for i, machine in enumerate(window.machines):
        if fallen[i]:
            found.append(FALLS)
        elif not stepping[i]:
            found.append(STOPS)
        else:
            found.append((*violations(machine, window.extremes_of(i)), WALKS)[0])
    return tuple(found)


def faults(found: Sequence[str]) -> dict[str, int]:
    """How many starts do not count, by verdict; only those that occur."""
    counts = Counter(found)
    return {each: counts[each] for each in VERDICTS if each != WALKS and each in counts}
