"""Results of a study's stages in files, each with digests of the files that the stage made.

A result counts only for the study it was made for, and only while it and its files are unchanged.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

from trajopt.files import read_signed, write_signed


def write_stage(folder: Path, name: str, study: dict[str, Any], result: dict[str, Any]) -> None:
    """Write the result of a stage.

    Args:
        folder: of the study.
        name: of the stage.
        study: what is studied, as plain values.
        result: plain values and arrays; "files", if there, names the files that the stage made.

    Raises:
        OSError: the folder cannot be written; a result that was there is kept.
    """
    files = {each: digest(folder / each) for each in result.get("files", ())}
    write_signed(_file(folder, name), {"study": study, "result": result, "files": files})


def read_stage(
    folder: Path, name: str, study: dict[str, Any]
) -> tuple[dict[str, Any] | None, list[str]]:
    """The result of a stage, None if it was not run; and the files that are missing or changed.

    Raises:
        ValueError: the result is damaged, was edited, or is of another study.
    """
    path = _file(folder, name)
    if not path.exists():
        return None, []
    remedy = "remove it to run its stage again, or choose another --out"
    try:
        content = read_signed(path)
    except ValueError as error:
        raise ValueError(f"{error}; {remedy}") from error
    if content["study"] != study:
        raise ValueError(f"{path}: of another study, {content['study']}; {remedy}")
    files = content["files"].items()
    changed = [each for each, then in files if digest(folder / each) != then]
    return dict(content["result"]), changed


def digest(path: Path) -> str | None:
    """SHA-256 of a file's content; None if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return None


def _file(folder: Path, name: str) -> Path:
    return folder / f"{name}.json"
