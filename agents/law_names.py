"""Feedback laws as tables and plots call them."""

from __future__ import annotations

#: Names that are not simply those of their files with spaces.
TITLES = {"input_output": "input-output", "lqr": "LQR", "pid": "PD"}


def law_title(law: str) -> str:
    """A law's name in words.

    Args:
        law: one of `trajopt.feedback.laws.names()`.
    """
    return TITLES.get(law, law.replace("_", " "))
