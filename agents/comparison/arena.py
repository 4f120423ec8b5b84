"""What the entrants of a comparison share: the study, its folder, the optimal front."""

from __future__ import annotations

import dataclasses
import json
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

from agents.comparison.report import policy_row
from agents.comparison.stages import read_stage
from agents.comparison.study import Study
from agents.evaluate import evaluate
from agents.gaps import gap_to_front
from agents.policies import Policy
from rimless_gym.params import WheelParams
from trajopt import NoGaitError, Solution
from trajopt.gaits.fronts import CotFront
from trajopt.ocp.ranking import tied

#: Plain values and arrays.
Result: TypeAlias = dict[str, Any]
Row: TypeAlias = dict[str, Any]


class Arena:
    """Where entrants compete.

    Args:
        study: what to compare.
        out: folder of the study.
        progress: whether to show progress bars.

    Attributes:
        identity: the study as plain JSON values.
    """

    def __init__(self, study: Study, out: Path, progress: bool) -> None:
        self.study, self.out, self.progress = study, out, progress
        self.identity: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(study)))

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return self.study.params

    @cached_property
    def front(self) -> CotFront:
        """The front of optimal gaits with a continuous voltage, from the result of its stage."""
        return self._front_of("front")

    @cached_property
    def held_front(self) -> CotFront:
        """The front that every gap is measured against: of gaits that the environment allows."""
        return self._front_of("held_front")

    def _front_of(self, stage: str) -> CotFront:
        names = (read_stage(self.out, stage, self.identity)[0] or {})["files"]
        return CotFront(tuple(Solution.load(self.out / name) for name in names))

    def held_gait(self, speed: float) -> Solution:
        """The environment's own best gait nearest to a speed (m/s)."""
        return min(self.held_front.envelope, key=lambda gait: abs(gait.speed - speed))

    def best_gait(self, speed: float) -> Solution:
        """The best gait nearest to a speed (m/s), of the fewest steps, with a continuous voltage.

        Raises:
            NoGaitError: there is none at the control interval's speed nearest to it.
        """
        wanted = self.study.on_tick(speed)
        there = [s for s in self.front.solutions if abs(s.speed - wanted) < 1e-6]
        if not there:
            raise NoGaitError(
                f"speed = {wanted:.4f} m/s: no verified gait; {self.out}/front.json says "
                "why; choose a speed between those that were found"
            )
        lowest = min(s.cot for s in there)
        as_good = [s for s in there if tied(s.cot, lowest, 1e-4)]
        return min(as_good, key=lambda s: s.steps)

    def evaluated(self, policy: Policy) -> Result:
        """A result with the evaluation of a policy."""
        evaluation = evaluate(policy, self.params, progress=self.progress)
        return {"evaluation": evaluation.to_dict()}

    def row(self, name: str, result: Result, at: float | None) -> Row:
        """The row of a policy, from a result of `evaluated`; see `policy_row`."""
        found = result["evaluation"]
        return policy_row(name, found, self.gap(found["cot"], found["speed"]), at)

    def gap(self, cot: float | None, speed: float | None) -> float | None:
        """Gap of a gait or a walk to the environment's own optimum; None off its front."""
        return gap_to_front(cot, speed, self.held_front)
