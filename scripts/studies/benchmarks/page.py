"""The results as a page of Markdown, which depends only on the JSON that the benchmark writes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from scripts.studies.benchmarks.cartpole import COST
from scripts.studies.benchmarks.cases import (
    ACCURACY,
    LANES,
    OPTIMISATION,
    PROCESS,
    SINGLE,
    TRAINING,
    VECTOR,
)
from scripts.studies.benchmarks.results import Result, by_key, values
from scripts.studies.benchmarks.tables import (
    goals_table,
    lanes_table,
    optimisation_table,
    process_table,
    speed_table,
    training_table,
)

_INTRODUCTION = """\
# Speed, ours and the peers'

Written by `make bench`: do not edit. **The peers have other physics**: ours walks, with impacts
located to rounding error and every joule booked; theirs swing or balance, in fewer and larger
steps. What is compared is what a step of a small environment costs its user.

Everything was measured in one run on one machine, in turn, in {rounds} rounds of {seconds:g} s
each. Rates are medians, followed by the slowest and the fastest round; ratios are medians of ratios
within a round. Ours replays the actions that an LQR took on an optimal gait, from {starts} states
of the walk for 2 s each: {touchdowns}of the control intervals have a touchdown, and replays end
{replay} the recorded states. Peers get random actions. Drawing actions and resetting are not timed,
except that peers' vector environments reset their rows within a step."""


_LANES = """\
## What eight lanes buy over one

The kernel computes eight wheels side by side (`rimless_gym/kernel/tile.py`). The same package with
one lane, compiled and measured in the same way, walks the same; ratios are within a round."""

_TRAINING = """\
## Training: time spent in environments

A tenth of a training by `agents.train`: roll-outs of PPO and its updates, figures of walking logged
at every step, and one evaluation and one saved state. The share is what the environments, in
roll-outs with their adapter, the log, and the environments in the evaluation take of all that."""

_OPTIMISATION = f"""\
## Trajectory optimisation

Kelly's cart-pole swing-up (SIAM Review 2017) with 40 segments, from a straight line as the guess,
on one core. The least cost is {COST} N^2 s. Building is everything from the equations to a solver
that is ready, without imports; solving is the rest. Times are medians. Costs differ a little where
the discretisation differs."""


#: From the time of numba's passes and LLVM's, with an empty NUMBA_CACHE_DIR.
_COMPILING = """\
The very first time is that of compiling the simulator: about 200 functions, nearly all of them
once. More than half of it is numba's own work in Python, typing and lowering; LLVM takes a quarter
for optimising and a fifth for writing machine code. So it would take about 12 s even if LLVM took
no time. A second process could only help with what the first `reset` needs, about a seventh,
because the rest is one chain of calls. LLVM also writes machine code for functions that are only
called by others and always linked into them, about an eighth; numba has no public way to leave that
out. `rimless warmup` does all of it beforehand."""


def page(run: dict[str, Any]) -> str:
    """The whole page."""
    results = run["results"]
    found = by_key(results)
    tables = [
        _introduction(run, found),
        "## Goals",
        goals_table(found),
        "## One environment, as `gym.make` gives it, on one core",
        speed_table(_of(results, SINGLE), found, "ours"),
        "## Many environments",
        speed_table(_of(results, VECTOR), found, "ours-vector-1024", sizes=True),
        _LANES,
        lanes_table(_of(results, LANES), found),
        _TRAINING,
        training_table(_of(results, TRAINING)),
        _OPTIMISATION,
        optimisation_table(_of(results, OPTIMISATION), found, "swing-up-bare"),
        "## A fresh process",
        process_table(_of(results, PROCESS)),
        _COMPILING,
        *(_accuracy(result) for result in _of(results, ACCURACY)),
        _machine(run),
    ]
    return "\n\n".join(tables) + "\n"


def _accuracy(result: Result) -> str:
    heading = "## Accuracy of what was timed\n\n"
    if not result["answers"]:
        return heading + f"Not measured: {result['error']}."
    state, event, drift = (
        max(values(result, name)) for name in ("state_error", "event_error", "event_drift")
    )
    pieces = sum(values(result, "steps"))
    return f"""{heading}Against the reference simulator over {pieces} pieces of 2 s of the walk:
states within {state:.0e} (rad, rad/s); touchdowns within {event:.0e} s when located from the
reference's state at the start of their control interval, within {drift:.0e} s when both walk on
their own for the 2 s, because a gait without feedback magnifies rounding errors."""


def _introduction(run: dict[str, Any], found: dict[str, Result]) -> str:
    ours = [r for key, r in found.items() if key.startswith(("ours", "kernel"))]
    shares = [r["about"]["touchdown_share"] for r in ours if "touchdown_share" in r["about"]]
    starts = [r["about"]["starts"] for r in ours if "starts" in r["about"]]
    replay = [error for r in ours for error in values(r, "replay_error")]
    return _INTRODUCTION.format(
        rounds=run["rounds"],
        seconds=run["seconds"],
        starts=max(starts, default="some"),
        touchdowns=f"{shares[0]:.1%} " if shares else "",
        replay=f"within {max(replay):.0e} of" if max(replay, default=0.0) > 0 else "exactly at",
    )


def _machine(run: dict[str, Any]) -> str:
    about = [result["about"] for result in run["results"] if result["about"]]
    versions = sorted({v for a in about for k, v in a.items() if k.endswith("version")})
    chosen = [
        f"- {r['title']}{'' if r['one_core'] else ', all cores'}: {r['about']['settings']}"
        for r in run["results"]
        if "settings" in r["about"]
    ]
    waits = [a for r in run["results"] for a in r["answers"] if a.get("idle", 0) > 0.1]
    idle = max((a["idle_cpu"] / a["idle"] for a in waits), default=0.0)
    machine, ours = run["machine"], run["versions"]
    return f"""## Machine and versions

{machine["cpu"]}, {machine["cores"]} cores, {machine["system"]}; load before {machine["load"]:.2f};
{run["date"]}; revision {run["git_revision"]}.

{", ".join(versions)}; numba {ours["numba"]}, numpy {ours["numpy"]}, Python {machine["python"]}.

The settings with which peers were fastest, of those that were tried beforehand:

{chr(10).join(chosen) or "- none"}

A worker that waited for its turn used at most {idle:.1%} of a core."""


def _of(results: Sequence[Result], group: str) -> list[Result]:
    return [result for result in results if result["group"] == group]
