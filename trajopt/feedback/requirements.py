"""What a law requires of the gait that it is to hold."""

from __future__ import annotations

from rimless_gym.checks import require_kind
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
