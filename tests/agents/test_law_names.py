"""Feedback laws have names in words."""

from __future__ import annotations

import pytest

from agents.policies import TITLES, law_title
from trajopt.feedback import laws


def test_every_law_is_called_by_words_and_no_two_by_the_same() -> None:
    titles = [law_title(name) for name in laws.names()]
    assert not any("_" in title for title in titles)
    assert len(set(titles)) == len(titles)


@pytest.mark.parametrize(
    ("law", "title"),
    [("lqr", "LQR"), ("sliding_mode", "sliding mode"), ("input_output", "input-output")],
)
def test_a_law_is_called_as_its_users_call_it(law: str, title: str) -> None:
    assert law_title(law) == title


def test_only_laws_have_titles() -> None:
    assert set(TITLES) <= set(laws.names())
