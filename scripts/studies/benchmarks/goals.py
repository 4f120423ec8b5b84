"""The goals for speed and accuracy, and how each is found in the results."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from scripts.studies.benchmarks.results import Result, quotient, slowest_ratio, typical, worst


@dataclasses.dataclass(frozen=True)
class Goal:
    """A figure, and the bound that it should reach.

    Attributes:
        title: what is compared.
        bound: that the figure should reach.
        measured: gives the figure from the results by key, or None if it is missing.
        form: the format of the figure. If it ends with "x", larger is better; else smaller is.
        stretch: a more ambitious bound, if any.
    """

    title: str
    bound: float
    measured: Callable[[dict[str, Result]], float | None]
    form: str = "{:.3g}x"
    stretch: float | None = None

    @property
    def at_most(self) -> bool:
        """Whether the bounds are upper bounds."""
        return not self.form.endswith("x")

    def reached(self, figure: float, bound: float) -> bool:
        """Whether a figure reaches a bound."""
        return figure <= bound if self.at_most else figure >= bound


def _single(name: str, bound: float, stretch: float) -> Goal:
    return Goal(f"`gym.make`, over {name}", bound, slowest_ratio("ours", [name]), stretch=stretch)


def _swing_up(name: str, bound: float, peers: list[str]) -> Goal:
    theirs = [f"swing-up-{peer}" for peer in peers]
    return Goal(
        f"building and solving it, over {name}",
        bound,
        slowest_ratio("swing-up-ours", theirs, "total"),
    )


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
    Goal(
        "solving Kelly's cart-pole, in the time of the bare script",
        1.3,
        slowest_ratio("swing-up-bare", ["swing-up-ours"], "solve"),
        "{:.3g} times",
    ),
    Goal(
        "building and solving it, in the time of the bare script",
        1.3,
        slowest_ratio("swing-up-bare", ["swing-up-ours"], "total"),
        "{:.3g} times",
    ),
    _swing_up("rockit (the faster of its methods)", 4, ["rockit-collocation", "rockit-shooting"]),
    _swing_up("Drake (the faster of its solvers)", 4, ["drake-ipopt", "drake-snopt"]),
    _swing_up("dymos", 40, ["dymos"]),
    Goal(
        "building it, in the time of solving it",
        2,
        quotient("swing-up-ours", "build", "solve"),
        "{:.3g} times",
    ),
    Goal("a gait of two steps, verified", 5, typical("gait", "seconds"), "{:.2g} s"),
    Goal("import to first step, compiled before", 3, typical("single", "seconds"), "{:.2g} s"),
    Goal("the very first time", 15, typical("single-cold", "seconds"), "{:.2g} s"),
    Goal("error of a touchdown's time", 1e-12, worst("accuracy", "event_error"), "{:.0e} s"),
    Goal("error of the states over 2 s", 1e-10, worst("accuracy", "state_error"), "{:.0e}"),
)
