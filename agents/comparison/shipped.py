"""Policies that come with the package as entrants of a comparison."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path

from agents.commanded import evaluate_commanded
from agents.comparison.arena import Arena, Result, Row
from agents.comparison.study import Study
from agents.policies import learned_policy
from agents.policy_files import PRETRAINED, load_policy
from rimless_gym.envs.task import USUAL_TASK

#: Their files; by the name alone, a file in the current folder would be found first.
FILE, SCREENED_FILE = PRETRAINED["front"], PRETRAINED["screened_ppo"]

#: What their rows are called.
TITLE, SCREENED = "one policy for the front", "PPO from screened policies"

#: Speeds between the study's at which it walks too (m/s), so that a plot shows its curve.
BETWEEN = (0.545, 0.58)


@dataclasses.dataclass(frozen=True)
class ForTheFront:
    """The shipped policy that walks at the speed that it is commanded.

    Attributes:
        commands: at which it walks (m/s).
        effort, after: see `agents.comparison.entrants.Entrant`.
    """

    commands: tuple[float, ...]
    effort: float = 40.0
    after: tuple[str, ...] = ("held_front",)

    @property
    def name(self) -> str:
        """Name of its stage. Another file or other commands make it another stage, which is run."""
        return f"one_for_the_front_{_digest(FILE, repr(self.commands))}"

    def compete(self, arena: Arena) -> Result:
        """Evaluate it at each speed."""
        shipped = load_policy(FILE)
        found = evaluate_commanded(
            learned_policy(shipped.act),
            self.commands,
            arena.params,
            task=USUAL_TASK,  # the others' returns are of this one
            control_period=shipped.conditions.control.period,
            progress=arena.progress,
        )
        return {"commanded": [each.evaluation.to_dict() for each in found]}

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """A row for every speed."""
        asked = {arena.study.on_tick(speed): speed for speed in arena.study.speeds}
        return [
            arena.row(TITLE, {"evaluation": evaluation}, asked.get(command, command))
            for command, evaluation in zip(self.commands, result["commanded"], strict=True)
        ]


@dataclasses.dataclass(frozen=True)
class FromScreened:
    """The shipped policy of PPO that goes on from screened policies, which is trained for longer.

    Attributes:
        effort, after: see `agents.comparison.entrants.Entrant`.
    """

    effort: float = 8.0
    after: tuple[str, ...] = ("held_front",)

    @property
    def name(self) -> str:
        """Name of its stage. Another file makes it another stage, which is run."""
        return f"screened_ppo_{_digest(SCREENED_FILE)}"

    def compete(self, arena: Arena) -> Result:
        """Evaluate it."""
        return arena.evaluated(load_policy(SCREENED_FILE).policy)

    def rows(self, arena: Arena, result: Result) -> list[Row]:
        """Its row; it chooses its own speed."""
        return [arena.row(SCREENED, result, None)]


def from_screened(study: Study) -> tuple[FromScreened, ...]:
    """The shipped policy, if the study's machine is its own."""
    return (FromScreened(),) if load_policy(SCREENED_FILE).params == study.params else ()


def for_the_front(study: Study) -> tuple[ForTheFront, ...]:
    """The shipped policy, if the study's machine is its own, at the study's speeds and between."""
    conditions = load_policy(FILE).conditions
    assert conditions.control.speeds is not None
    slowest, fastest = conditions.control.speeds
    inner = [study.on_tick(speed) for speed in study.speeds]
    between = [speed for speed in BETWEEN if min(inner) < speed < max(inner)]
    commands = tuple(s for s in sorted({*inner, *between}) if slowest <= s <= fastest)
    return (ForTheFront(commands),) if conditions.params == study.params and commands else ()


def _digest(file: Path, more: str = "") -> str:
    return hashlib.sha256(file.read_bytes() + more.encode()).hexdigest()[:8]
