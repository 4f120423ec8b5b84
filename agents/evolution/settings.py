"""How evolution searches, in numbers."""

from __future__ import annotations

import dataclasses

from agents.training import Settings
from rimless_gym.checks import integer, positive

#: Generations between two looks at how the mean policy walks.
LOOK_EVERY = 10

#: The least that numbers may be, where it is not 1. A trial ends with a look, CMA-ES needs a few
#: policies, and a walk is judged by its second half.
LEAST = {"silent": 0, "trial": LOOK_EVERY, "race": LOOK_EVERY, "population": 4} | dict.fromkeys(
    ("glance", "screen_intervals", "intervals", "refining_intervals", "setting_off_intervals"), 2
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvolutionSettings(Settings):
    """How evolution searches.

    Attributes:
        n_timesteps: control intervals in all; refining lasts until then.
        screened: random policies.
        screen_starts: of each of them.
        glance: intervals of their first, short walk.
        kept: most policies of one sense of turning that walk for longer.
        screen_intervals: of the longer walk.
        contenders: most of each family in the trial.
        trial: generations of each contender; those that do not walk then are out.
        finalists: of each family after the trial; and of all families after the first round.
        race: generations of the first round; the second has twice as many.
        population: policies of a generation.
        intervals: of a walk in the race; its second half is judged.
        starts: of a policy in the race.
        refining_intervals: of a walk afterwards. Some policies fall after half a minute, and in
            short walks what is left of the start-up hides the cost of the gait.
        refining_starts: of a policy afterwards, in every other generation.
        setting_off_intervals: of a walk in the generations between: to get going, and little more.
        setting_off_starts: of a policy in these.
        looked_at: starts from which the mean policy is looked at during the race.
        refining_looked_at: the same afterwards. The best of many looks is kept; from few starts
            that would be the luckiest one.
        least_judged: share of the starts by which a policy is judged while it walks from few; 1 for
            always all of them.
        spread: standard deviation of the first generation, in root mean squares of the weights.
        first_price: price of distance at the beginning; far above the cost of clumsy walking.
        paid_speed: speed up to which distance is paid (m/s), so that no family is preferred
            because it runs.

    Raises:
        TypeError: a number is of the wrong kind.
        ValueError: a number is out of its range.
    """

    n_timesteps: int = 600_000_000
    screened: int = 50_000
    screen_starts: int = 4
    glance: int = 200
    kept: int = 1500
    screen_intervals: int = 600
    contenders: int = 12
    trial: int = 10
    finalists: int = 3
    race: int = 30
    population: int = 24
    intervals: int = 800
    starts: int = 24
    refining_intervals: int = 5000
    refining_starts: int = 12
    setting_off_intervals: int = 1000
    setting_off_starts: int = 60
    looked_at: int = 64
    refining_looked_at: int = 256
    least_judged: float = 0.1
    spread: float = 0.3
    first_price: float = 5.0
    paid_speed: float = 0.6

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            least = LEAST.get(field.name, 1)
            if isinstance(field.default, int):
                integer(field.name, getattr(self, field.name), least)
            else:
                positive(field.name, getattr(self, field.name))
        for name in ("trial", "race"):
            if getattr(self, name) % LOOK_EVERY:
                raise ValueError(
                    f"{name} = {getattr(self, name)}: must be a multiple of {LOOK_EVERY}, after "
                    "which a policy is looked at"
                )
        if self.least_judged > 1.0:
            raise ValueError(f"least_judged = {self.least_judged}: a share, must be at most 1")
