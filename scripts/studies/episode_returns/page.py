"""The tables of returns in docs/environment.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium as gym

from agents.baselines import BASELINES
from scripts.studies.documents import marked
from scripts.studies.documents.markdown import table
from scripts.studies.episode_returns.measure import COMMANDED, FRONT, WHEEL
from trajopt.feedback import laws

ENVIRONMENTS = (WHEEL, COMMANDED)
MARKS, WANTED = marked.marks("returns", ENVIRONMENTS), marked.wanted("returns", ENVIRONMENTS)

MEANINGS = {"idle": "no voltage: rests", "random": "a uniformly random voltage in every step"}


def sections(found: Mapping[str, Any]) -> dict[str, str]:
    """The tables by environment, from what `measure.returns` gives."""
    return {env: _table(env, found) + "\n" for env in ENVIRONMENTS}


def _table(env: str, found: Mapping[str, Any]) -> str:
    threshold = gym.spec(env).reward_threshold
    rows = [
        [_who(row, found), *_figures(row)]
        for row in sorted(found[env], key=lambda row: float(row["mean"]))
    ]
    rows.append(["`reward_threshold`: two thirds of the front's", f"{threshold:g}", "", ""])
    return table(["who walks", "return, mean (m)", "standard deviation", "end early"], rows)


def _figures(row: Mapping[str, Any]) -> list[str]:
    if row["name"] == FRONT:
        return [f"{row['mean']:.2f}", "", ""]
    return [f"{row['mean']:.2f}", f"{row['spread']:.2f}", f"{100 * row['early']:.0f} %"]


def _who(row: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    name = row["name"]
    if name in BASELINES:
        return f"`{name}`: {MEANINGS[name]}"
    if name in laws.names():
        return f"law `{name}` about the optimum at {found['law_speed']:.3f} m/s"
    if name == FRONT and "speed" in row:
        return f"the front's best gait, at {row['speed']:.3f} m/s, walked for all 20 s"
    if name == FRONT:
        return "the front, walked at the commanded speed for all 20 s"
    if "speeds" in row:
        slowest, fastest = row["speeds"]
        period = f"a decision every {1e3 * row['period']:g} ms"
        return f"policy `{name}`, commanded {slowest:g} to {fastest:g} m/s, {period}"
    return f"policy `{name}`"
