"""The walks that are drawn: the best law, its clone and what else has a name for the plots."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from agents.comparison.arena import Arena
from agents.comparison.deviations import deviation_charts, deviations, steps_of
from agents.comparison.entrants import Entrant
from agents.comparison.learned import Learned
from agents.comparison.return_maps import last_middle, return_chart, return_map
from agents.comparison.speed_figure import colour_of_policy
from agents.conditions import Conditions
from agents.experts import EXPERT
from agents.law_names import law_title
from agents.policies import Policy, controller_policy
from agents.policy_files import load_policy
from agents.reports.charts import Chart
from agents.rollout import Interval, Rollout, at_rest
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from trajopt.feedback import laws
from trajopt.gaits.solution import Solution

#: Seconds of a walk, and those at its end in which it is steady.
DRAWN, STEADY = 20.0, 10.0

_STEADY = round(STEADY / CONTROL_PERIOD)


class Shown(NamedTuple):
    """A policy whose walk is drawn.

    Attributes:
        name: what the plots call it.
        colour: of its walk, a name in `agents.reports.colours`.
        policy: see `agents.policies`.
        walk: from rest, as long as `DRAWN`, or until it falls.
        optimum: the environment's own best gait, at the walk's speed as nearly as there is one.
        holds: whether it is to hold that gait; else it chose its speed itself.
    """

    name: str
    colour: str
    policy: Policy
    walk: list[Interval]
    optimum: Solution
    holds: bool


def shown_walks(arena: Arena, entrants: Sequence[Entrant]) -> list[Shown]:
    """The walks to show of a comparison that is over, the law's first."""
    gait = arena.held_gait(arena.study.speed)
    law = controller_policy(arena.params, laws.design(EXPERT, gait, arena.out))
    found = [_shown(arena, law_title(EXPERT), law, arena.study.speed)]
    for each in entrants:
        if isinstance(each, Learned) and each.drawn:
            policy = load_policy(each.main_file(arena.out)).policy
            found.append(_shown(arena, each.drawn, policy, each.speed))
    return found


def _shown(arena: Arena, name: str, policy: Policy, speed: float | None) -> Shown:
    walk = list(walk_from_rest(arena.params, policy, DRAWN))
    held = arena.held_gait(_speed(walk) if speed is None else speed)
    return Shown(name, colour_of_policy(name), policy, walk, held, speed is not None)


def walk_from_rest(params: WheelParams, policy: Policy, seconds: float) -> Rollout:
    """One walk of a policy."""
    n_intervals = round(seconds / CONTROL_PERIOD)
    return Rollout(Conditions(params), policy, at_rest(params)[None], n_intervals)


def _speed(walk: Sequence[Interval]) -> float:
    """Over its last seconds (m/s)."""
    steady = walk[-_STEADY:]
    distance = sum(float(interval.info["distance"][0]) for interval in steady)
    return distance / (len(steady) * CONTROL_PERIOD)


def is_steady(walk: Sequence[Interval]) -> bool:
    """Whether a walk lasts for its whole time, and still takes steps at its end."""
    steps = sum(float(interval.info["steps"][0]) for interval in walk[-_STEADY:])
    return (
        len(walk) == round(DRAWN / CONTROL_PERIOD) and steps > 1 and last_middle(walk) is not None
    )


def cycle_charts(shown: Sequence[Shown]) -> list[Chart]:
    """The deviations of steady walks from the optimum; walks beside one gait share their charts."""
    gaits = {id(each.optimum): each.optimum for each in shown if is_steady(each.walk)}
    charts: list[Chart] = []
    for key, gait in gaits.items():
        found = {}
        for each in shown:
            if id(each.optimum) == key and is_steady(each.walk):
                steps = steps_of(each.walk[-_STEADY:])
                found[each.name] = deviations(steps, gait), each.colour
        charts += deviation_charts(found, f"at {gait.speed:.2f} m/s")
    return charts


def return_charts(params: WheelParams, shown: Sequence[Shown]) -> list[Chart]:
    """The return maps of steady walks."""
    charts = []
    for each in shown:
        if is_steady(each.walk):
            free = float(abs(each.optimum.floquet[0])) if each.holds else None
            found = return_map(params, each.policy, each.walk)
            if found.spread > 0.0:
                charts.append(return_chart(each.name, found, each.colour, free))
    return charts
