"""A page that people pass on: the front, a policy and a wheel to drive, in one HTML file."""

from __future__ import annotations

import base64
import json
import math
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policy_files import Checkpoint, load_policy
from rimless_gym.envs.arguments import USUAL
from rimless_gym.equations import LOSSES, equations
from rimless_gym.javascript import simulator
from rimless_gym.params import WheelParams
from trajopt.gaits.fronts import CotFront, shipped_front
from trajopt.gaits.solution import Solution

#: The page's own program, in order; the simulator comes before it.
SCRIPTS = (
    *("numbers.js", "network.js", "walkers.js", "scene.js", "strips.js", "front.js"),
    *("drive.js", "scores.js", "machine.js", "main.js"),
)

#: The longest time between two samples of a gait (s), and of one that lasts for longer than `LONG`
#: (s), most of which is a rest; and points of each, over which power is integrated.
SAMPLED, SPARSELY, LONG, FINE = 0.008, 0.024, 2.0, 48

#: What is sampled: angles (rad), voltage (V), power drawn (W) and energy drawn since the stride
#: began (J), both with the idle power and without regeneration.
COLUMNS = ("phi", "theta", "voltage", "power", "energy")

_eq = equations(np.sin, np.cos, sqrt=np.sqrt)

#: Layers of the actor of stable-baselines3's PPO, without their `.weight` and `.bias`.
_HIDDEN, _LAST = "mlp_extractor.policy_net.", "action_net"


def page(policy: str | Path = "imitation") -> str:
    """The page as HTML; it loads nothing.

    Args:
        policy: a policy file, or the name of a policy that comes with the package. Its machine is
            the page's, and must have a shipped front.

    Raises:
        CheckpointError: the policy cannot be read.
        ValueError: it is of a kind that a page cannot run.
        NoFrontError: its machine has no shipped front.
    """
    checkpoint = load_policy(policy)
    data = {
        "machine": checkpoint.params.to_dict() | {"weight": checkpoint.params.weight},
        "columns": COLUMNS,
        "front": front_data(shipped_front(checkpoint.params)),
        "network": network_data(checkpoint),
    }
    parts = {
        "style": "".join(_static(name) for name in ("base.css", "style.css")),
        "program": "\n".join(
            [
                f"const DATA = {json.dumps(data, separators=(',', ':'))};",
                simulator(),
                *(_static(name) for name in SCRIPTS),
            ]
        ),
    }
    text = _static("page.html")
    for name, part in parts.items():
        text = text.replace(f"{{{{ {name} }}}}", part)
    return text


def _static(name: str) -> str:
    return (files("agents") / "static" / "page" / name).read_text(encoding="utf-8")


def front_data(front: CotFront) -> list[dict[str, Any]]:
    """The envelope of a front as JSON values, one entry per gait, in order of speed."""
    return [_gait(gait) for gait in front.envelope]


def _gait(gait: Solution) -> dict[str, Any]:
    durations: list[float] = []
    samples: list[NDArray[np.float64]] = []
    energy = 0.0
    sampled = SPARSELY if gait.duration > LONG else SAMPLED
    spent = dict.fromkeys((*LOSSES, "collision", "idle", "returned"), 0.0)
    for step, phase in enumerate(gait.phases):
        count = math.ceil(phase.duration / sampled)
        t = np.linspace(0.0, phase.duration, count * FINE + 1)
        columns, lost = _walked(gait.params, phase.state(t), phase.control(t)[:, 0], t)
        columns[-1] += energy
        energy = float(columns[-1, -1])
        durations.append(phase.duration)
        samples.append(columns[:, ::FINE])
        for name, joules in lost.items():
            spent[name] += joules
        following = gait.phases[(step + 1) % gait.steps].start
        spent["collision"] += _collision(gait.params, phase.end, following)
    return {
        "speed": gait.speed,
        "cot": gait.cot,
        "turns": gait.theta_turns,
        "durations": durations,
        "counts": [columns.shape[1] for columns in samples],
        "samples": packed(np.concatenate(samples, axis=1)),
        "spent": spent,
    }


def _walked(
    params: WheelParams, x: NDArray[np.float64], u: NDArray[np.float64], t: NDArray[np.float64]
) -> tuple[NDArray[np.float64], dict[str, float]]:
    """The `COLUMNS` over a step, and what became of its energy (J)."""
    p, (phi, theta, dphi, dtheta) = params.constants, x.T
    acc = _eq.single_stance(phi, theta, dphi, dtheta, u, p)
    dpsi = _eq.relative_rate(dphi, dtheta, p)
    electrical = _eq.electrical_power(dpsi, u, p)
    powers = _eq.losses(dphi, dpsi, _eq.relative_rate(*acc, p), u, p)._asdict()
    powers |= {"idle": np.full_like(t, params.idle_power), "returned": np.maximum(-electrical, 0)}
    drawn = np.maximum(electrical, 0.0) + params.idle_power
    steps = 0.5 * (drawn[1:] + drawn[:-1]) * np.diff(t)
    energy = np.append(0.0, np.cumsum(steps))
    lost = {name: float(np.trapezoid(power, t)) for name, power in powers.items()}
    return np.stack([phi, theta, u, drawn, energy]), lost


def _collision(
    params: WheelParams, before: NDArray[np.float64], after: NDArray[np.float64]
) -> float:
    """Energy lost in a forward touchdown (J)."""
    p = params.constants
    left = _eq.mechanical_energy(*after, p) - _eq.descent(0.0, p)
    return float(_eq.mechanical_energy(*before, p) - left)


def network_data(policy: Checkpoint) -> list[dict[str, Any]]:
    """The layers of a policy's network as JSON values; tanh follows all but the last."""
    kwargs, weights = policy.record.get("policy_kwargs", {}), policy.parts.weights
    plain = policy.conditions.control == USUAL and kwargs.get("activation_fn", "Tanh") == "Tanh"
    hidden = sorted(
        {name.rpartition(".")[0] for name in weights if name.startswith(_HIDDEN)},
        key=lambda name: int(name.removeprefix(_HIDDEN)),
    )
    if not (plain and hidden):
        raise ValueError(
            f"a {policy.algo} policy with {policy.conditions.control} and {kwargs}: a page runs "
            "networks of tanh layers that set the voltage every 10 ms; choose such a policy, as "
            "'imitation' or 'evolved'"
        )
    return [
        {
            "outputs": int(weights[f"{name}.weight"].shape[0]),
            "weights": packed(weights[f"{name}.weight"]),
            "biases": packed(weights[f"{name}.bias"]),
        }
        for name in (*hidden, _LAST)
    ]


def packed(array: NDArray[Any]) -> str:
    """An array as text: little-endian numbers of single precision in base64, row by row."""
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")
