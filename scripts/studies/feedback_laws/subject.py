"""What is measured: a law about a held gait, or any other policy that walks near one."""

from __future__ import annotations

import dataclasses
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Protocol

from agents.policies import Policy, controller_policy
from rimless_gym.params import WheelParams
from trajopt.feedback import laws
from trajopt.feedback.law import Controller, Law
from trajopt.gaits.solution import Solution


class Walker(Protocol):
    """A policy, its machine, and the gait near which it walks."""

    @property
    def policy(self) -> Policy:
        """As the environment takes it."""

    @property
    def params(self) -> WheelParams:
        """The machine that it was made for."""

    @property
    def gait(self) -> Solution:
        """From whose states it is pushed, and sent up and down slopes."""


@dataclasses.dataclass(frozen=True)
class Subject:
    """A law about a gait.

    Attributes:
        gait: the gait.
        name: of the law.
    """

    gait: Solution
    name: str

    @property
    def params(self) -> WheelParams:
        """The machine that the law was designed for."""
        return self.gait.params

    @cached_property
    def law(self) -> Law:
        """By itself."""
        return laws.holding(self.name, self.gait)

    @cached_property
    def controller(self) -> Controller:
        """With the catch and the guard; laws about the same gait share the catch."""
        return laws.design(self.name, self.gait)

    @cached_property
    def policy(self) -> Policy:
        """The controller, as the environment takes it."""
        return controller_policy(self.params, self.controller)


@lru_cache(maxsize=32)
def subject_of(path: Path, name: str) -> Subject:
    """A law about a kept gait; designed and compiled only once in a process."""
    return Subject(Solution.load(path), name)
