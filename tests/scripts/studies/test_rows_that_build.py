"""Rows of the study that build on others, and lines that stay on its page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from agents.folder import BEST, CLONE
from agents.training import IMITATION
from rimless_gym import BUILDABLE
from scripts.studies import page, trials
from scripts.studies.rows import LEARNED
from scripts.studies.trials import RESULT, Continued

HEAD = ["| policy | CoT |", "| --- | --- |"]


def test_a_row_without_new_results_keeps_its_lines() -> None:
    old = [*HEAD, "| clone | 1 |", "| PPO, best kept | 2 |", "| PPO, last | 3 |", "| gone | 4 |"]
    new = [*HEAD, "| evolution | 6 |", "| clone | 5 |"]
    titles = ["clone", "PPO", "evolution"]
    assert page.with_kept(new, old, titles) == [
        *HEAD,
        "| clone | 5 |",
        "| PPO, best kept | 2 |",
        "| PPO, last | 3 |",
        "| evolution | 6 |",
    ]


def test_lines_under_another_head_do_not_stay() -> None:
    old = ["| policy | speed |", "| --- | --- |", "| PPO | 2 |"]
    new = [*HEAD, "| clone | 5 |"]
    assert page.with_kept(new, old, ["clone", "PPO"]) == new


def test_a_page_keeps_what_a_part_of_the_study_does_not_tell(tmp_path: Path) -> None:
    path, rest = (
        tmp_path / "page.md",
        "text\n<!-- study: learned -->\n{}\n<!-- end of learned -->\n",
    )
    path.write_text(rest.format("\n".join([*HEAD, "| clone | 1 |", "| PPO | 2 |"])))
    page.refresh(path, {LEARNED: "\n".join([*HEAD, "| clone | 5 |"])}, ["clone", "PPO"])
    wanted = rest.format("\n".join([*HEAD, "| clone | 5 |", "| PPO | 2 |"]))
    assert path.read_text() == wanted


def test_a_row_goes_on_from_the_clone_of_the_same_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[str] = []

    def training(algo: str, init: str, seed: int, out: Path, **options: Any) -> Any:
        begun.append(init)
        raise KeyboardInterrupt

    monkeypatch.setattr(trials, "train", training)
    trial = Continued("ppo", IMITATION, 64, (("", BEST),), begun="imitation")
    folder = tmp_path / "fine_tuned_3"
    folder.mkdir()
    with pytest.raises(ValueError, match=r"imitation_3 is not finished.*run --rows imitation"):
        trial.train(3, folder, BUILDABLE)
    other = tmp_path / "imitation_3"
    other.mkdir()
    (other / RESULT).write_text("{}")
    with pytest.raises(KeyboardInterrupt):
        trial.train(3, folder, BUILDABLE)
    assert begun == [str(other / CLONE)]
