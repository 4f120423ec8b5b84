"""Whoever has a name and walks: feedback laws, policies of the package, policies in files."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from agents.conditions import Conditions
from agents.policies import Policy, controller_policy, learned_policy
from agents.policy_files import load_policy
from rimless_gym.envs.task import Task
from rimless_gym.params import WheelParams
from rimless_gym.presets import BUILDABLE
from trajopt.feedback import laws
from trajopt.gaits.solution import Solution


@dataclasses.dataclass(frozen=True)
class Walker:
    """A policy, and what it walks on.

    Attributes:
        name: of the law or the policy, or the file's path.
        policy: as the environment takes it.
        conditions: machine and control, undisturbed.
        task: for which a policy was trained; None for laws.
        gait: that a law holds; None for policies.
        command: the speed that is commanded (m/s), if any.
    """

    name: str
    policy: Policy
    conditions: Conditions
    task: Task | None = None
    gait: Solution | None = None
    command: float | None = None

    @property
    def params(self) -> WheelParams:
        """The machine."""
        return self.conditions.params

    @property
    def period(self) -> float:
        """How long an action is held (s)."""
        return self.conditions.control.period


def walker(
    name: str,
    gait_for: Callable[[WheelParams], Solution],
    params: WheelParams | None = None,
    *,
    trust_pickle: bool = False,
) -> Walker:
    """A feedback law, a policy that comes with the package, or one in a file.

    Args:
        name: of the law or the policy, or the file's path.
        gait_for: finds the gait of a machine that a law is to hold; called only for laws.
        params: the machine; None: a policy's own, and for laws BUILDABLE or that of the gait found.
        trust_pickle: see `agents.policy_files.load_policy`.

    Raises:
        ValueError: the gait is of another machine than `params`.
        CheckpointError: there is no such law or policy, or the policy is for another machine.
        NoGaitError: there is no gait to hold.
    """
    if name in laws.names():
        gait = gait_for(params or BUILDABLE)
        if params is not None and gait.params != params:
            raise ValueError(
                f"{name}: is to hold a gait of another machine: {gait.params.differences(params)}; "
                "give a gait of the machine, or leave out params (--preset and --params)"
            )
        policy = controller_policy(gait.params, laws.design(name, gait))
        return Walker(name, policy, Conditions(gait.params), gait=gait)
    found = load_policy(name, params, trust_pickle=trust_pickle)
    conditions = Conditions(found.params, control=found.conditions.control)
    return Walker(name, learned_policy(found.act), conditions, found.task)
