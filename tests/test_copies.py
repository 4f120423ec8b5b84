"""`trajopt.ocp` stands alone, so it has copies of a few small functions: they stay alike."""

from __future__ import annotations

import inspect

import pytest
from trajopt.ocp.judge import zeros

from rimless_gym import checks, crossings
from trajopt.ocp import checks as engine_checks

COPIES = [
    (name, ours, copy)
    for ours, copy in ((checks, engine_checks), (crossings, zeros))
    for name, function in inspect.getmembers(copy, inspect.isfunction)
    if function.__module__ == copy.__name__
]


@pytest.mark.parametrize(("name", "ours", "copy"), COPIES)
def test_a_copy_is_the_same_to_the_letter(name: str, ours: object, copy: object) -> None:
    assert inspect.getsource(getattr(ours, name)) == inspect.getsource(getattr(copy, name))
