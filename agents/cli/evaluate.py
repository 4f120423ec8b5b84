"""`rimless evaluate`."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import arg

from agents.cli.options import (
    Fields,
    Flag,
    MaybeCount,
    MaybePath,
    MaybePositive,
    MaybePositives,
    MaybePreset,
    Names,
    machine,
)

if TYPE_CHECKING:
    from agents.evaluate import Evaluation
    from agents.policy_files import NamedPolicy
    from rimless_gym.params import WheelParams

COLUMNS = (
    ("walking_share", "walking"),
    ("speed", "speed m/s"),
    ("cot", "CoT"),
    ("over_least", "over least CoT"),
    ("gap", "gap"),
    ("return_20_s", "return m"),
    ("return_share", "of the best"),
    ("friction_demand", "friction"),
    ("impulse_friction_demand", "at touchdown"),
    ("min_normal_force_over_weight", "least Fy/weight"),
    ("min_clearance", "clearance m"),
)

#: A commanded speed is kept if the walk's differs from it by no more than this share. At 0.5 m/s, a
#: control period of 10 ms more per step makes 2 %.
KEPT = 0.02


def evaluate(
    policies: Names = (),
    *,
    gait: MaybePath = None,
    speed: MaybePositive = None,
    steps: MaybeCount = None,
    commands: MaybePositives = (),
    gap: Flag = False,
    no_gap: Flag = False,
    trust_pickle: Flag = False,
    seeds: Flag = False,
    headline: Flag = False,
    json_: Annotated[bool, arg(name="json", help_behavior_hint="")] = False,
    preset: MaybePreset = None,
    params: Fields = None,
    ranges: Fields = None,
    disturbances: Fields = None,
) -> int:
    """Measure policies and feedback laws.

    They walk from 128 fixed starts for 50 s; figures are those of the last 30 s. A start walks if
    it still takes steps at the end, and if in the last 30 s its foot is pressed down and does not
    slip, and its pendulum does not touch the floor. Two figures compare its CoT with that of the
    best periodic gait of 1 to 3 steps per stride whose voltage is held for 10 ms: "over least CoT"
    at any speed, the gap at the walked speed. Policies that decide at other intervals are compared
    with the shipped gaits, whose voltage may change at any time. "return" is the mean one of an
    episode of 20 s, start-up included, "of the best" its share of what the best gait returns (at
    the commanded speed, if any) that is walked from the first moment.

    Args:
        policies: a policy's file (.zip), a policy that comes with the package, a feedback law, or
            module:name of a function of observations (N, 6), or of a model with such a `predict`;
            `rimless list` names them
        gait: file of the gait that laws hold (.npz)
        speed: of the gait that laws hold (m/s), whose voltage is held for 10 ms; by default 0.62
        steps: per stride, of the gait that laws hold; by default 1
        commands: speeds for policies that are commanded one (m/s); empty: every 0.02 m/s in the
            range that they were trained for
        gap: compare with optimal gaits also where none of the machine are shipped; it takes
            minutes there
        no_gap: do not compare with optimal gaits
        trust_pickle: also read files of plain stable-baselines3, which runs any code their author
            put in
        seeds: the policies are seeds of one training: print interquartile mean and 95 % interval,
            and how many walk
        headline: print rows of the README's table
        json_: print everything as JSON
        preset: machine that the policies must be for; by default the one each was trained on
        params: fields that differ from the preset's: hub_damping=0.01 n_legs=6
        ranges: parameters to draw for every episode: pendulum_mass=[2.0,2.4]
        disturbances: pushes.rate=0.5 pushes.impulse=[0.1,0.5] terrain.slope_std=0.01
            sensor_noise.leg_rate=0.1
    """
    from agents.conditions import Conditions
    from agents.evaluate import evaluate as measured
    from rimless_gym.envs.arguments import as_speeds
    from rimless_gym.hybrid import CONTROL_PERIOD
    from trajopt.store import provenance

    if not policies:
        raise ValueError("name a policy or a feedback law; `rimless list` lists them")
    _require_distinct(policies)
    if gap and no_gap:
        raise ValueError("--gap and --no-gap exclude each other")
    params_ = machine(preset, params) if preset or params else None

    def gait_for(params: WheelParams) -> Any:
        from trajopt import Solution, periodic_gait

        if gait is not None:
            return Solution.load(gait)
        return periodic_gait(params, speed or 0.62, steps or 1, hold=CONTROL_PERIOD, progress=True)

    named: list[NamedPolicy] = []  # all of them, before the first is measured
    for name in policies:
        named += _at_commands(name, gait_for, params_, commands, trust_pickle)
    if (gait or speed or steps) and all(w.gait is None for w in named):
        raise ValueError("--gait, --speed, --steps: are for feedback laws, and none is named")
    commanded = any(w.command is not None for w in named)
    if seeds and commanded:
        raise ValueError("--seeds: policies that are commanded a speed are not summarised")
    if commands and not commanded:
        raise ValueError("--commands: none of these policies is commanded a speed")
    if commands:
        as_speeds("--commands", commands, len(commands))
    conditions = [Conditions.of(w.params, ranges, disturbances) for w in named]
    rows = []
    with TemporaryDirectory() as gaits:
        for w in named:
            result = measured(
                w.policy,
                w.params,
                command=w.command,
                control_period=w.period,
                progress=True,
                ranges=ranges,
                disturbances=disturbances,
            )
            compared = not no_gap and (gap or _quick(w.params))
            rows.append(_row(w, result, Path(gaits) if compared else None))
    names = [w.name for w in named]
    summary = over_seeds(rows) if seeds else {}
    if json_:
        shared = {name: conditions[0].to_dict()[name] for name in ("ranges", "disturbances")}
        results = dict(zip(names, rows, strict=True))
        report = {"policies": results, "over_seeds": summary, **shared, **provenance()}
        print(json.dumps(report, indent=1))
    elif headline:
        print(headline_rows(named, rows))
    else:
        print(table(names, rows, summary))
    return 0


def _require_distinct(policies: Sequence[str]) -> None:
    """Refuse a policy that is named twice, be it by two copies of its file."""
    from agents.policy_files import CheckpointError, find_policy
    from trajopt.store import file_digest

    named: dict[str | None, str] = {}
    for name in policies:
        try:
            content = file_digest(find_policy(name))
        except CheckpointError:  # a law, or no such file
            content = name
        if content in named:
            raise ValueError(f"{name}: is the same policy as {named[content]}; name each once")
        named[content] = name


def _at_commands(
    name: str, gait_for: Any, params: WheelParams | None, commands: Sequence[float], trust: bool
) -> list[NamedPolicy]:
    """A law or policy; where it is commanded a speed, at each of several."""
    from agents.evaluate import commands_within
    from agents.policy_files import named_policy

    named = named_policy(name, gait_for, params, trust_pickle=trust)
    speeds = named.conditions.control.speeds
    if speeds is None:
        return [named]
    return [
        dataclasses.replace(named, name=f"{name} at {speed} m/s", command=speed)
        for speed in dict.fromkeys(commands or commands_within(*speeds))
    ]


def _quick(params: WheelParams) -> bool:
    """Whether optimal gaits of a machine are shipped, from which others are solved soon."""
    from trajopt.gaits.library import index

    return any(gait.params == params for gait in index())


def _row(w: NamedPolicy, result: Evaluation, gaits: Path | None) -> dict[str, Any]:
    """The figures of a policy, compared with optimal gaits if there is a folder for these."""
    figures: dict[str, Any] = dict.fromkeys(("over_least", "gap", "return_share"))
    if gaits is not None:
        figures = _compared(w, result, gaits)
    kept = None
    if w.command is not None and result.walking_share:
        kept = abs(result.speed / w.command - 1.0) <= KEPT
    return {
        **result.to_dict(),
        **figures,
        "return_20_s": float(result.returns.mean()),
        "command": w.command,
        "command_kept": kept,
        "control_period": w.period,
    }


def _compared(w: NamedPolicy, result: Evaluation, gaits: Path) -> dict[str, Any]:
    """The gaps to optimal gaits, and the share of the best one's return."""
    from agents.evaluate import EPISODE
    from agents.gaps import best_at_any_speed, gap_to_front, gap_to_optimum, reward_rate
    from rimless_gym.hybrid import CONTROL_PERIOD
    from trajopt.gaits.fronts import shipped_front

    front = shipped_front(w.params) if _quick(w.params) else None
    least = gap = rate = None
    if w.period == CONTROL_PERIOD:
        least = best_at_any_speed(w.params, result.speed, gaits, progress=True)
        gap = gap_to_optimum(w.params, result.cot, result.speed, gaits, progress=True)
    elif front is not None:
        least = min(front.envelope, key=lambda gait: gait.cot)
        gap = gap_to_front(result.cot, result.speed, front)
    if w.command is None and least is not None:
        rate = reward_rate(least)
    elif w.command is not None and front is not None:
        weight = w.conditions.default_task.distance_weight
        if front.envelope[0].speed <= w.command <= front.envelope[-1].speed:
            rate = (weight - float(front(w.command))) * w.command
    return {
        "over_least": result.cot / least.cot - 1.0 if least and result.walking_share else None,
        "gap": gap,
        "return_share": None if rate is None else float(result.returns.mean()) / (EPISODE * rate),
    }


def headline_rows(named: Sequence[NamedPolicy], rows: Sequence[dict[str, Any]]) -> str:
    """The policies in a table as that of the README."""
    from agents.comparison.table import headline_table, policy_row

    shown = []
    for policy, figures in zip(named, rows, strict=True):
        row = dataclasses.replace(
            policy_row(policy.name, figures, figures["gap"], None),
            over_least=figures["over_least"],
            return_share=figures["return_share"],
            **policy.effort._asdict(),
        )
        shown.append((policy.name, row, "-"))
    strayed = _strayed((policy.name for policy in named), rows)
    return "\n".join([headline_table(shown), *([""] if strayed else []), *strayed])


def over_seeds(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Interquartile mean and 95 % interval of each figure, and over how many seeds.

    Starts and returns are those of all seeds, other figures those of the seeds that walk.
    """
    from agents.evaluate import ENOUGH, bootstrap_interval, interquartile_mean

    summary: dict[str, Any] = {}
    for name, _ in COLUMNS:
        of_all = name in ("walking_share", "return_20_s", "return_share")
        some = [row for row in rows if of_all or row["walking_share"] >= ENOUGH]
        values = [row[name] for row in some if row[name] is not None]
        if values:
            low, high = bootstrap_interval(values)
            mean = interquartile_mean(values)
            summary[name] = {"mean": mean, "low": low, "high": high, "seeds": len(values)}
    return summary


def table(names: Sequence[str], rows: Sequence[dict[str, Any]], summary: dict[str, Any]) -> str:
    """One line a policy, then the summary, then why starts do not count."""
    from agents.evaluate import ENOUGH

    width = max(24, *(len(name) for name in names))
    lines = [" " * width + "".join(f"{title:>16}" for _, title in COLUMNS)]
    for name, row in zip(names, rows, strict=True):
        lines.append(f"{name:{width}}" + "".join(_cell(c, row[c]) for c, _ in COLUMNS))
    if summary:
        for title, key in (("interquartile mean", "mean"), ("95 % from", "low"), ("to", "high")):
            cells = [_cell(c, summary.get(c, {}).get(key)) for c, _ in COLUMNS]
            lines.append(f"{title:{width}}" + "".join(cells))
        walk = summary.get("cot", {}).get("seeds", 0)
        lines.append(f"{walk} of {len(rows)} walk, from at least {ENOUGH:.0%} of their starts")
    for name, row in zip(names, rows, strict=True):
        if row["failures"]:
            count, starts = sum(row["failures"].values()), row["protocol"]["starts"]
            reasons = ", ".join(f"{n} {outcome}" for outcome, n in row["failures"].items())
            lines.append(f"{name}: {count} of {starts} starts do not count ({reasons})")
    return "\n".join([*lines, *_strayed(names, rows)])


def _strayed(names: Iterable[str], rows: Iterable[dict[str, Any]]) -> list[str]:
    """Lines about those who do not walk at the speed that is commanded."""
    return [
        f"{name}: walks at {row['speed']:.3f} m/s, over {KEPT:.0%} off; the command is not kept"
        for name, row in zip(names, rows, strict=True)
        if row["command_kept"] is False
    ]


def _cell(column: str, figure: float | None) -> str:
    """A figure of the table; a dash where nothing walks, or there is nothing to compare with."""
    if figure is None or not math.isfinite(figure):
        return f"{'-':>16}"
    forms = {"over_least": "+16.1%", "gap": "+16.1%", "return_share": "16.0%"}
    return format(figure, forms.get(column, "16.4g"))
