"""The command that writes datasets."""

from __future__ import annotations

from pathlib import Path

import pytest

from agents.cli import data
from agents.folder import sole_user


def test_it_writes_what_is_missing_and_says_where(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = ["--episodes", "2", "--out", str(tmp_path)]
    assert data.main(["idle", *few]) == 0
    before = (tmp_path / "rimless-wheel" / "idle-v0" / "README.md").stat().st_mtime_ns
    assert data.main(["idle", "random", *few]) == 0
    assert (tmp_path / "rimless-wheel" / "idle-v0" / "README.md").stat().st_mtime_ns == before
    assert (tmp_path / "rimless-wheel" / "random-v0" / "data" / "metadata.json").is_file()
    told = capsys.readouterr().out
    assert f"{tmp_path}: set MINARI_DATASETS_PATH to it" in told


def test_a_folder_in_which_another_process_writes_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with sole_user(tmp_path), pytest.raises(SystemExit) as end:
        data.main(["idle", "--episodes", "1", "--out", str(tmp_path)])
    assert end.value.code == 2
    assert f"another process is working in {tmp_path}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nobody"], "nobody: no such file, and no policy of that name"),
        (["evolution", "--preset", "PROTOTYPE"], "trained on another machine"),
        (["idle", "--episodes", "0"], "at least 1"),
    ],
)
def test_what_cannot_be_written_is_refused(
    arguments: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        data.main([*arguments, "--out", str(tmp_path)])
    assert end.value.code == 2
    assert told in capsys.readouterr().err
    assert not list(tmp_path.glob("[!.]*"))
