"""What a law requires of the gait that it is to hold, and of its machine."""

from __future__ import annotations

from typing import Any

from rimless_gym.checks import require_kind
from rimless_gym.params import WheelParams
from trajopt.gaits.solution import Solution


def require_verified(solution: Solution) -> None:
    """Refuse what is no gait, and a gait that failed its verification.

    Raises:
        TypeError: it is not a `trajopt.Solution`.
        ValueError: it failed its verification.
    """
    require_kind("solution", solution, Solution)
    if not solution.verification.passed:
        raise ValueError(
            "solution: this gait failed its verification ("
            + "; ".join(solution.verification.failures)
            + "), so no law can hold it; solve it again, with `starts` or at another speed"
        )


def require_machine(name: str, made: Any, params: WheelParams) -> None:
    """Refuse a law, or another controller that knows its machine, if that is not `params`.

    Raises:
        ValueError: it was made for another machine.
    """
    machine = getattr(made, "params", params)
    if isinstance(machine, WheelParams) and machine != params:
        raise ValueError(
            f"{name}: made for another machine: {machine.differences(params)}; make it for this one"
        )
