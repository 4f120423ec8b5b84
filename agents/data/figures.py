"""The figures of a dataset, and its card."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from agents.data.walks import Walks
from agents.episodes import Episode
from rimless_gym.envs.arguments import Control

CARD = """\
# `{id}`

Walks of {made}, in `{env}` of rimless-gym, as a Minari dataset.

| | |
| --- | --- |
| environment | `{env}`, {machine}, {control}, the reward as registered |
| walker | {made} |
| episodes, steps | {episodes}, {steps:,}; {begun} |
| return (m), mean, least, greatest | {mean:.3f}, {least:.3f}, {greatest:.3f} |
| standard deviation of the return (m) | {spread:.3f} |
| episodes that end early | {early:.0%} |
| distance, energy drawn | {distance:.1f} m, {energy:.1f} J |
| cost of transport, the way to the gait included | {cot} |
| stored `infos` | {infos} |
| made by | `{command}`, revision {revision}, with {versions} |
| licence | MIT, as rimless-gym |

Read it with Minari:

```python
import minari, rimless_gym  # with MINARI_DATASETS_PATH set to the folder that --out named
dataset = minari.load_dataset("{id}")
env = dataset.recover_environment()
```

Every episode can be walked again, bit for bit: reset the environment with the `seed` (and the
`options`, if any) in the episode's metadata, and step it with the recorded actions.
"""


def figures(walked: Sequence[Episode], weight: float) -> dict[str, Any]:
    """What a card tells of episodes, as plain JSON values.

    Args:
        walked: episodes with the entries of `info` that datasets hold.
        weight: of the machine (N).
    """
    totals = np.array([one.total for one in walked])
    sums = {name: float(sum(one.infos[name].sum() for one in walked)) for name in walked[0].infos}
    energy = sums["electrical_positive"] + sums["idle"]
    forward = sums["distance"] > 0.0
    return {
        "episodes": len(walked),
        "steps": sum(len(one.rewards) for one in walked),
        "mean": float(totals.mean()),
        "spread": float(totals.std()),
        "least": float(totals.min()),
        "greatest": float(totals.max()),
        "early": float(np.mean([one.terminations[-1] for one in walked])),
        "distance": sums["distance"],
        "energy": energy,
        "cot": energy / (weight * sums["distance"]) if forward else None,
    }


def card(name: str, env: str, walks: Walks, found: Mapping[str, Any], by: Mapping[str, Any]) -> str:
    """The text of a card.

    Args:
        name: the dataset's identifier.
        env: the environment's.
        walks: the dataset.
        found: what `figures` gives.
        by: provenance, with the command line.
    """
    first, cot = walks.episodes[0], found["cot"]
    last = walks.episodes[-1].seed
    start = "`reset` with the options of each" if first.options else "the environment's own starts"
    return CARD.format(
        id=name,
        env=env,
        made=walks.made,
        machine=json.dumps(by["machine"]) if by["machine"] else "the default machine",
        control=_control(walks.conditions.control),
        begun=f"{start}, seeds {first.seed} to {last}",
        infos=", ".join(f"`{entry}`" for entry in first.infos),
        command=by["command"],
        revision=str(by["git_revision"])[:10],
        versions=", ".join(f"{key} {version}" for key, version in by["versions"].items()),
        **{**found, "cot": "-" if cot is None else f"{cot:.4f}"},
    )


def _control(control: Control) -> str:
    """How often a walker decides, and what speeds it is commanded, if any."""
    decides = f"a decision every {1e3 * control.period:g} ms"
    if control.speeds is None:
        return decides
    least, greatest = control.speeds
    return f"{decides}, commanded {least:g} to {greatest:g} m/s"
