"""One HTML file with everything in it."""

from __future__ import annotations

import json
from importlib.resources import files
from pathlib import Path
from typing import Any

from agents.page.gaits import COLUMNS, front_data
from agents.page.network import network_data
from agents.policy_files import load_policy
from rimless_gym.javascript import simulator
from rimless_gym.params import WheelParams
from trajopt.files import write_text
from trajopt.gaits.fronts import shipped_front

#: The page's own program, in order; the simulator comes before it.
SCRIPTS = (
    *("numbers.js", "network.js", "walkers.js", "scene.js", "strips.js", "front.js"),
    *("drive.js", "scores.js", "machine.js", "main.js"),
)


def page(policy: str | Path = "imitation") -> str:
    """The page as HTML; it loads nothing.

    Args:
        policy: a policy file, or the name of a policy that comes with the package. Its machine is
            the page's, and must have a shipped front.

    Raises:
        CheckpointError: the policy cannot be read.
        ValueError: it is of a kind that a page cannot run, or its machine has no shipped front.
    """
    checkpoint = load_policy(policy)
    data = {
        "machine": checkpoint.params.to_dict() | _derived(checkpoint.params),
        "columns": COLUMNS,
        "front": front_data(shipped_front(checkpoint.params)),
        "network": network_data(checkpoint),
    }
    parts = {
        "style": "".join(_static(name) for name in ("base.css", "style.css")),
        "program": "\n".join(
            [
                f"const DATA = {json.dumps(data, separators=(',', ':'))};",
                simulator(checkpoint.params),
                *(_static(name) for name in SCRIPTS),
            ]
        ),
    }
    text = _static("page.html")
    for name, part in parts.items():
        text = text.replace(f"{{{{ {name} }}}}", part)
    return text


def write_page(path: str | Path, policy: str | Path = "imitation") -> Path:
    """Write the page to a file and return its path; see `page` for what it raises.

    A file that was there is replaced as a whole.
    """
    path = Path(path)
    text = page(policy)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, text)
    return path


def _derived(params: WheelParams) -> dict[str, Any]:
    return {"weight": params.weight}


def _static(name: str) -> str:
    return (files(__package__) / "static" / name).read_text(encoding="utf-8")
