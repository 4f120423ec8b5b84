"""How much is measured: for fast laws, for slow ones, and for a trial."""

from __future__ import annotations

import dataclasses

#: A law that takes longer than this per wheel, in a batch, counts as slow (s).
SLOW = 100e-6


@dataclasses.dataclass(frozen=True)
class Sizes:
    """Numbers of starts, phases, states and so on.

    Attributes:
        seeds: sets of starts of the full protocol.
        starts: in each of them.
        few_starts: of the short protocol, for everything that is changed or disturbed.
        phases: of the step at which a push comes.
        impulses: tried side by side, before the bisection.
        bisections: between the largest that was survived and the next.
        states: random ones, for the region of attraction.
        slope_step: deg.
        slope_starts: on the gait.
        deviations: small ones, whose decay is measured.
        shorter: divides all times of the full and the short protocol.
    """

    seeds: int
    starts: int
    few_starts: int
    phases: int
    impulses: int
    bisections: int
    states: int
    slope_step: float
    slope_starts: int
    deviations: int
    shorter: float = 1.0


FOR_FAST_LAWS = Sizes(
    seeds=4,
    starts=128,
    few_starts=48,
    phases=8,
    impulses=20,
    bisections=5,
    states=400,
    slope_step=0.5,
    slope_starts=8,
    deviations=32,
)

FOR_SLOW_LAWS = dataclasses.replace(
    FOR_FAST_LAWS,
    seeds=3,
    starts=8,
    few_starts=4,
    phases=4,
    impulses=8,
    bisections=3,
    states=48,
    slope_step=1.0,
    slope_starts=4,
    deviations=8,
)

FOR_A_TRIAL = dataclasses.replace(
    FOR_SLOW_LAWS,
    starts=4,
    phases=2,
    impulses=4,
    bisections=2,
    states=16,
    slope_step=2.5,
    slope_starts=2,
    deviations=4,
    shorter=4.0,
)


def sizes_for(slow: bool, quick: bool) -> Sizes:
    """The sizes for a law."""
    if quick:
        return FOR_A_TRIAL
    return FOR_SLOW_LAWS if slow else FOR_FAST_LAWS
