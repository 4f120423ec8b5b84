"""Returns of default episodes over seeded starts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from agents.baselines import BASELINES, walker_or_baseline
from agents.conditions import Conditions
from agents.episodes import episodes
from agents.policies import Policy
from agents.policy_files import PRETRAINED
from rimless_gym import BUILDABLE
from rimless_gym.envs.layout import MIDDLE_SPEED, SPEED_SCALE
from rimless_gym.envs.speed import SPEEDS
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from scripts.studies.episode_returns.bounds import best_gait, earned, earned_at
from trajopt import periodic_gait
from trajopt.feedback import laws
from trajopt.files import read_signed, write_signed
from trajopt.gaits.solution import Solution
from trajopt.provenance import provenance

#: Episodes of every walker; episode i is that of `reset(seed=i)`.
EPISODES = 100

#: Speed of the gait that laws hold (m/s), as in the README's table.
SPEED = 0.56

WHEEL, COMMANDED = "RimlessWheel-v0", "RimlessWheelSpeed-v0"

#: Name of the row of the front's gaits; no policy has it.
FRONT = "the front"

Row = dict[str, Any]


def returns(folder: Path, count: int = EPISODES) -> dict[str, Any]:
    """The rows of both environments' tables, as plain JSON values.

    Args:
        folder: where every walker's rows are kept; those of the same revision are not measured
            again.
        count: episodes of every walker.
    """
    made_by = provenance(episodes=count)
    tables: dict[str, list[Row]] = {WHEEL: [], COMMANDED: []}
    for env, row in _measured_rows(folder, everybody(), made_by):
        tables[env].append(row)
    return {"law_speed": _gait(BUILDABLE).speed, **tables, **made_by}


def renewed(recorded: Mapping[str, Any], folder: Path, names: Sequence[str]) -> dict[str, Any]:
    """The recorded rows, with those of some walkers measured anew.

    Args:
        recorded: what `returns` gave. Its provenance stays; a new row has its own revision.
        folder: see `returns`.
        names: of the walkers, among `everybody`.
    """
    made_by = provenance(episodes=recorded["episodes"])
    tables = {
        env: [row for row in recorded[env] if row["name"] not in names]
        for env in (WHEEL, COMMANDED)
    }
    for env, row in _measured_rows(folder, names, made_by):
        tables[env].append(row | {"git_revision": made_by["git_revision"]})
    return {**recorded, **tables}


def everybody() -> list[str]:
    """All who have a row: baselines, laws, policies of the package, the front."""
    return [*BASELINES, *laws.names(), *PRETRAINED, FRONT]


def _measured_rows(
    folder: Path, names: Sequence[str], made_by: dict[str, Any]
) -> Iterator[tuple[str, Row]]:
    """The rows of some walkers, each with its environment, under a progress bar."""
    with tqdm(names, desc="returns") as bar:
        for name in bar:
            bar.set_postfix_str(name)
            yield from _kept(folder / f"{name}.json", name, made_by)["rows"]


def _kept(path: Path, name: str, made_by: dict[str, Any]) -> dict[str, Any]:
    """The file of a walker's rows, measured now unless it is there."""
    if path.exists():
        found = read_signed(path)
        if {key: found[key] for key in made_by} == made_by:
            return found
    rows = _front_rows if name == FRONT else _rows
    write_signed(path, {"rows": list(rows(name, made_by["episodes"])), **made_by})
    return read_signed(path)


def measured(policy: Policy, conditions: Conditions, count: int) -> Row:
    """Mean and standard deviation of the returns, and the share of episodes that end early."""
    envs = conditions.envs(count, max_episode_steps=conditions.control.episode_steps)
    walked = episodes(envs, policy)
    totals = np.array([one.total for one in walked])
    early = np.mean([one.terminations[-1] for one in walked])
    return {"mean": totals.mean(), "spread": totals.std(ddof=1), "early": float(early)}


def _rows(name: str, count: int) -> Iterator[tuple[str, Row]]:
    """The rows of a walker, each with its environment; baselines are in both."""
    found = walker_or_baseline(name, _gait)
    row = {"name": name} | measured(found.policy, found.conditions, count)
    if found.conditions.commanded:
        yield COMMANDED, row | {"speeds": found.conditions.control.speeds, "period": found.period}
    else:
        yield WHEEL, row
    if name in BASELINES:
        yield COMMANDED, {"name": name} | measured(BASELINES[name](0), _commanded(), count)


def _front_rows(name: str, count: int) -> Iterator[tuple[str, Row]]:
    """What the gaits of the front would earn."""
    best = best_gait()
    yield WHEEL, {"name": name, "mean": earned(best), "speed": best.speed}
    yield COMMANDED, {"name": name, "mean": float(earned_at(_commands(count)).mean())}


def _gait(params: WheelParams) -> Solution:
    return periodic_gait(params, SPEED, hold=CONTROL_PERIOD)


def _commanded() -> Conditions:
    """The conditions of `RimlessWheelSpeed-v0`."""
    return Conditions.of(BUILDABLE, None, None, SPEEDS)


def _commands(count: int) -> np.ndarray[Any, Any]:
    """The speeds that the episodes command (m/s)."""
    observations, _ = _commanded().envs(count).reset(seed=0)
    return np.asarray(MIDDLE_SPEED + SPEED_SCALE * observations[:, 6].astype(float))
