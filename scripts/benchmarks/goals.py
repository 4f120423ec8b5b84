"""What is to be reached, and how it is read off the results."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from scripts.benchmarks.results import Result, slowest_ratio, typical, worst


@dataclasses.dataclass(frozen=True)
class Goal:
    """A figure and its bound.

    Attributes:
        title: what is compared.
        bound: to reach.
        measured: the figure from the results by key, None where it is missing.
        form: how figures are written.
        stretch: a bound beyond, if any.
    """

    title: str
    bound: float
    measured: Callable[[dict[str, Result]], float | None]
    form: str = "{:.3g}x"
    stretch: float | None = None

    @property
    def at_most(self) -> bool:
        """Whether bounds are upper ones: for anything but ratios."""
        return not self.form.endswith("x")

    def reached(self, figure: float, bound: float) -> bool:
        """Whether a figure is on the right side of a bound."""
        return figure <= bound if self.at_most else figure >= bound


def _single(name: str, bound: float, stretch: float) -> Goal:
    return Goal(f"`gym.make`, over {name}", bound, slowest_ratio("ours", [name]), stretch=stretch)


GOALS = (
    _single("CartPole-v1", 3, 5),
    _single("Acrobot-v1", 15, 30),
    _single("InvertedDoublePendulum-v5", 30, 60),
    Goal(
        "vector, one thread, N = 1024, over EnvPool Acrobot at its best setting",
        15,
        slowest_ratio("ours-vector-1024", ["envpool-acrobot"]),
    ),
    Goal(
        "the same over Gymnasium's native CartPole, N = 1024",
        1,
        slowest_ratio("ours-vector-1024", ["cartpole-vector-1024"]),
    ),
    Goal(
        "vector, one thread, N = 16384, over gymnax Acrobot (the faster of one core and all)",
        2,
        slowest_ratio("ours-vector-16384", ["gymnax-acrobot-one", "gymnax-acrobot-all"]),
        stretch=3,
    ),
    Goal("share of PPO's training time, 8 environments", 0.05, typical("ppo-8", "share"), "{:.1%}"),
    Goal("the same with 256", 0.01, typical("ppo-256", "share"), "{:.1%}"),
    Goal("import to first step, compiled before", 3, typical("single", "seconds"), "{:.2g} s"),
    Goal("the very first time", 15, typical("single-cold", "seconds"), "{:.2g} s"),
    Goal("error of a touchdown's time", 1e-12, worst("accuracy", "event_error"), "{:.0e} s"),
    Goal("error of the states over 2 s", 1e-10, worst("accuracy", "state_error"), "{:.0e}"),
)
