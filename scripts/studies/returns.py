"""The study `returns`: the tables of docs/environment.md."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from agents.cli.options import Count, MaybePath
from agents.conditions import Conditions
from agents.evaluate import EPISODE
from agents.experts import EXPERT_SPEED
from agents.gaps import reward_rate, ticks_around
from agents.policy_files import BASELINES, PRETRAINED, named_policy
from agents.rollout import Policy, episodes
from rimless_gym import BUILDABLE
from rimless_gym.envs.layout import commanded_speeds
from rimless_gym.envs.speed import SPEEDS, TASK
from rimless_gym.equations import DOUBLE
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from scripts.studies.documents import markdown
from trajopt import periodic_gait
from trajopt.feedback import laws
from trajopt.gaits.fronts import cot_front, shipped_front
from trajopt.gaits.solution import Solution
from trajopt.ocp.arrays import Array
from trajopt.store import Store, provenance

#: Episodes of each policy; episode i is that of `reset(seed=i)`.
EPISODES = 100

#: Speed of the gait that laws hold (m/s), as in the README's table.
SPEED = EXPERT_SPEED

WHEEL, COMMANDED = ENVIRONMENTS = ("RimlessWheel-v0", "RimlessWheelSpeed-v0")
MARKS = markdown.marks("returns", ENVIRONMENTS)

#: Name of the row of the front's gaits; no policy has it.
FRONT = "the front"

MEANINGS = {"idle": "no voltage: rests", "random": "a uniformly random voltage in every step"}

Row = dict[str, Any]


def returns(
    *, episodes: Count = EPISODES, out: Path = Path("runs/returns"), docs: MaybePath = None
) -> int:
    """Measure the return of default episodes: baselines, laws, policies, the front's best gait.

    Each walks the episodes that reset(seed=0), reset(seed=1), ... begin, as gym.make gives them. It
    takes some ten minutes of one core, most of it for the receding horizon and the design of the
    tuned law. After Ctrl-C or a kill, the same command continues.

    Args:
        episodes: of each policy.
        out: folder of the study.
        docs: a page, docs/environment.md, to put the tables into; returns.json goes beside it.
    """
    results = all_returns(out, episodes)
    tables = sections(results)
    if docs:
        docs.with_name("returns.json").write_text(json.dumps(results, indent=1) + "\n")
        markdown.refresh(docs, MARKS, tables)
    print("\n".join(tables.values()))
    return 0


def all_returns(folder: Path, count: int, names: Sequence[str] | None = None) -> dict[str, Any]:
    """The rows of both environments' tables, as plain JSON values."""
    made_by = provenance(episodes=count)
    names = [*BASELINES, *laws.names(), *PRETRAINED, FRONT] if names is None else names
    tables: dict[str, list[Row]] = {env: [] for env in ENVIRONMENTS}
    with Store(folder, made_by) as store, tqdm(names, desc="returns") as bar:
        for name in bar:
            bar.set_postfix_str(name)
            if name not in store:
                rows = _front_rows(count) if name == FRONT else _rows(name, count)
                store.save(name, list(rows))
            for env, row in store.load(name):
                tables[env].append(row)
    return {"law_speed": _gait(BUILDABLE).speed, **tables, **made_by}


def measured(policy: Policy, conditions: Conditions, count: int) -> Row:
    """Means and standard deviation of the returns, and the share of episodes that end early."""
    envs = conditions.envs(count, max_episode_steps=conditions.control.episode_steps)
    walked = episodes(envs, policy, keep=["mode"])
    totals = np.array([one.total for one in walked])
    rests = np.array([one.infos["mode"][0] == DOUBLE for one in walked])
    kinds = {"rest": totals[rests], "motion": totals[~rests]}
    early = np.mean([one.terminations[-1] for one in walked])
    return {
        "mean": float(totals.mean()),
        **{kind: float(some.mean()) for kind, some in kinds.items() if some.size},
        "spread": float(totals.std(ddof=1)),
        "early": float(early),
    }


def _rows(name: str, count: int) -> Iterator[tuple[str, Row]]:
    """The rows of a policy, each with its environment; baselines are in both."""
    policy = named_policy(name, _gait)
    row = {"name": name} | measured(policy.policy, policy.conditions, count)
    if policy.conditions.commanded:
        speeds = list(policy.conditions.control.speeds or ())
        yield COMMANDED, row | {"speeds": speeds, "period": policy.period}
    else:
        yield WHEEL, row
    if name in BASELINES:
        yield COMMANDED, {"name": name} | measured(BASELINES[name](0), _commanded(), count)


def _front_rows(count: int) -> Iterator[tuple[str, Row]]:
    """The returns of the front's gaits, walked from an episode's beginning to its end."""
    best = best_gait()
    mean = EPISODE * reward_rate(best)
    yield WHEEL, {"name": FRONT, "mean": mean, "speed": best.speed}
    yield COMMANDED, {"name": FRONT, "mean": float(front_return(commands(SPEEDS, count)).mean())}


def commands(speeds: tuple[float, float], count: int) -> Array:
    """The speeds (m/s) that default episodes command which draw them between two, (count,)."""
    envs = Conditions.of(BUILDABLE, None, None, speeds).envs(count)
    observations, _ = envs.reset(seed=0)
    return commanded_speeds(observations)


def best_gait() -> Solution:
    """The gait of the front with the greatest return, its voltage held for 10 ms.

    A step of such a gait lasts a whole number of intervals: the best continuous gait lies between
    two of these speeds, and the better one of the two counts.
    """
    best = max(shipped_front(BUILDABLE).envelope, key=reward_rate)
    ticks = ticks_around(BUILDABLE, best.speed)
    speeds = [BUILDABLE.step_length / (n * CONTROL_PERIOD) for n in ticks]
    front = cot_front(BUILDABLE, speeds, [best.steps], hold=CONTROL_PERIOD)
    return max(front.envelope, key=reward_rate)


def front_return(speed: ArrayLike, cost: float = 1.0) -> Array:
    """The returns in `RimlessWheelSpeed-v0` of 20 s at commanded speeds (m/s).

    They are those of walks at `cost` times the front's CoT. A bound: the gaits may change their
    voltage at any time, and walk from the beginning.
    """
    speeds = np.asarray(speed, dtype=float)
    return EPISODE * speeds * (TASK.distance_weight - cost * shipped_front(BUILDABLE)(speeds))


def _gait(params: WheelParams) -> Solution:
    return periodic_gait(params, SPEED, hold=CONTROL_PERIOD)


def _commanded() -> Conditions:
    """The conditions of `RimlessWheelSpeed-v0`."""
    return Conditions.of(BUILDABLE, None, None, SPEEDS)


def sections(results: Mapping[str, Any]) -> dict[str, str]:
    """The tables by environment, from what `returns` gives."""
    return {env: _table(env, results) + "\n" for env in ENVIRONMENTS}


def _table(env: str, results: Mapping[str, Any]) -> str:
    spec = gym.spec(env)
    lines = [
        [_title(row, results), f"{row['mean']:.2f}"]
        + (
            [""] * 4
            if row["name"] == FRONT
            else [
                *(f"{row[kind]:.2f}" for kind in ("rest", "motion")),
                *(f"{row['spread']:.2f}", f"{100 * row['early']:.0f} %"),
            ]
        )
        for row in sorted(results[env], key=lambda row: float(row["mean"]))
    ]
    lines.append(["`reward_threshold`", f"{spec.reward_threshold:g}", *[""] * 4])
    head = ["policy", "return, mean (m)", "from rest", "in motion", "standard deviation"]
    return markdown.table([*head, "end early"], lines)


def _title(row: Mapping[str, Any], results: Mapping[str, Any]) -> str:
    name = row["name"]
    if name in BASELINES:
        return f"`{name}`: {MEANINGS[name]}"
    if name in laws.names():
        return f"law `{name}` about the optimum at {results['law_speed']:.3f} m/s"
    if name == FRONT and "speed" in row:
        return f"the front's best gait, at {row['speed']:.3f} m/s, walked for all 20 s"
    if name == FRONT:
        return "the front, walked at the commanded speed for all 20 s"
    if "speeds" in row:
        slowest, fastest = row["speeds"]
        period = f"a decision every {1e3 * row['period']:g} ms"
        return f"policy `{name}`, commanded {slowest:g} to {fastest:g} m/s, {period}"
    return f"policy `{name}`"
