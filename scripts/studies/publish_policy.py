"""Put a policy that is not of the comparison into the package, with a card that tells of it."""

from __future__ import annotations

import dataclasses
import json
import shutil
from collections.abc import Sequence
from pathlib import Path

from agents.cli.commandline import Parser
from agents.commanded import commands_within
from agents.comparison.report import policy_row
from agents.evaluate import evaluate
from agents.gaps import gap_to_optimum
from agents.policies import learned_policy
from agents.policy_files import load_policy, read_record
from rimless_gym.envs.arguments import USUAL
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.presets import machine_name
from scripts.studies.documents.cards import card, commanded_card
from scripts.studies.publish import POLICIES, PRETRAINED

AGAIN = "docs/learning.md has the command that trains it;"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = Parser(__doc__)
    parser.add_argument("name", help="in the package")
    parser.add_argument("policy", type=Path, help="its file (.zip), in the folder of its training")
    parser.add_argument("title", help="of its card")
    options = parser.parse_args(arguments)
    if not options.name.isidentifier() or options.name in POLICIES:
        parser.error(
            f"{options.name}: must be a plain name, and not one of the comparison's: "
            f"{', '.join(POLICIES)}"
        )
    notes = options.policy.with_name("train.json")
    if not options.policy.is_file() or not notes.is_file():
        parser.error(f"{options.policy}: give the .zip in the folder of its training")
    for suffix in (".zip", ".md"):
        parser.require_file(PRETRAINED / f"{options.name}{suffix}")
    with parser.refusing():
        policy = load_policy(options.policy)
        control = policy.conditions.control
        if dataclasses.replace(control, speeds=None) != USUAL:
            parser.error(
                f"{options.policy}: does not set a voltage every {CONTROL_PERIOD:g} s, as the "
                f"optimum does; train it with --control-period {CONTROL_PERIOD:g}"
            )
        init = json.loads(notes.read_text())["init"]
        commands = [None] if control.speeds is None else commands_within(*control.speeds)
        walks = [
            evaluate(
                learned_policy(policy.act),
                policy.params,
                command=command,
                control_period=CONTROL_PERIOD,
                progress=True,
            )
            for command in commands
        ]
        if not any(walk.walking.any() for walk in walks):
            parser.error(f"{options.policy}: walks from no start; a card is of one that walks")
    gaps = [gap_to_optimum(policy.params, w.cot, w.speed, progress=True) for w in walks]
    rows = [
        policy_row(options.title, walk.to_dict(), gap, command)
        for walk, gap, command in zip(walks, gaps, commands, strict=True)
    ]
    machine, record = machine_name(policy.params), read_record(options.policy)
    if control.speeds is None:
        text = card(options.name, record, rows[0], machine, init, AGAIN)
    else:
        text = commanded_card(options.name, record, rows, machine, init, AGAIN)
    shutil.copyfile(options.policy, PRETRAINED / f"{options.name}.zip")
    (PRETRAINED / f"{options.name}.md").write_text(text)
    return 0
