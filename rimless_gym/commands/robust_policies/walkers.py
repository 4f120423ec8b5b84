"""What is measured: learned policies and feedback laws, each with the gait near which it walks."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from agents.evaluate import evaluate
from agents.policies import Policy
from agents.policy_files import CheckpointError
from agents.protocol import SHORT_PROTOCOL
from agents.walkers import walker
from rimless_gym.envs.control import USUAL
from rimless_gym.hybrid import CONTROL_PERIOD
from rimless_gym.params import WheelParams
from trajopt import periodic_gait
from trajopt.gaits.solution import Solution

#: Speed of the gait that laws hold (m/s): that of the clones, too.
SPEED = 0.56


@dataclasses.dataclass(frozen=True)
class Walking:
    """A policy near a gait.

    Attributes:
        name: in the tables.
        policy: as the environment takes it.
        gait: from whose states it is pushed, and sent up and down slopes.
    """

    name: str
    policy: Policy
    gait: Solution

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return self.gait.params


def shown_name(name: str) -> str:
    """What tables call a law, a policy that comes with the package, or one in a file."""
    return Path(name).stem


def walking(name: str, given: WheelParams | None) -> Walking:
    """A feedback law, a policy that comes with the package, or one in a file.

    Args:
        name: of the law or the policy, or the file's path.
        given: the machine; None: that of the policy, or BUILDABLE.

    Raises:
        CheckpointError: it is neither, the policy is for another machine or control, or it does
            not walk.
        NoGaitError: there is no gait near its speed.
    """

    def gait_for(machine: WheelParams, speed: float = SPEED) -> Solution:
        return periodic_gait(machine, speed, 1, hold=CONTROL_PERIOD)

    found = walker(name, gait_for, given)
    if found.gait is not None:
        return Walking(shown_name(name), found.policy, found.gait)
    if found.conditions.control != USUAL:
        raise CheckpointError(
            f"{name}: walks at a commanded speed, or does not decide every {CONTROL_PERIOD:g} s; "
            "the gaits here are of other walks: give a policy for RimlessWheel-v0"
        )
    walk = evaluate(found.policy, found.params, SHORT_PROTOCOL)
    if not walk.walking.any():
        raise CheckpointError(f"{name}: walks from no start; give a policy that walks")
    return Walking(shown_name(name), found.policy, gait_for(found.params, walk.speed))
