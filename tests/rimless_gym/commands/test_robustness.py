"""The tables of how robust policies are."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import pytest

from rimless_gym.commands.robust_policies import command
from rimless_gym.commands.robust_policies.page import sections

PUSHES: dict[str, Any] = {"largest_tried": 5.0} | {
    f"{side}_{kind}": [0.5, 1.0, 5.0]
    for side in ("backward", "forward")
    for kind in ("walking", "stepping")
}
HARDLY = {"share": 0.02, "cot": math.nan, "speed": 0.0, "faults": {"falls": 1}}
FOUND: dict[str, Any] = {
    "nuisances": {"starts": 48, "figures": {"undisturbed": HARDLY}},
    "pushes": PUSHES,
    "slopes": {"up": 1.0, "down": 0.5},
    "machines": {"starts": 48, "parameters": {"gear_ratio": {"+20%": HARDLY}}},
}


def test_columns_of_which_nothing_was_measured_are_left_out() -> None:
    head, _, row = sections({"a": FOUND})["pushes"].splitlines()
    assert "random states" not in head
    assert row == "| `a` " + 4 * "| 0.50, 1.00, ≥ 5.00 " + "| 1 up to 0.5 down |"


def test_walks_that_get_nowhere_have_no_cost_of_transport(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "walking", lambda name, given: SimpleNamespace(name=name))
    measures = {name: lambda one, sizes, of=of: of for name, of in FOUND.items()}
    monkeypatch.setattr(command, "COLUMNS", measures)
    assert command.main(["a", "--quick"]) == 0
    told = capsys.readouterr().out
    assert "| `gear_ratio` +20% | 2 % (98 %) |" in told
    assert "nan" not in told
