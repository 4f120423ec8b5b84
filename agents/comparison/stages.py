"""Results of a study's stages in files, each with digests of the files that the stage made.

A result counts only for the study it was made for, and only while it and its files are unchanged.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from trajopt.files import jsonable, write_text


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
    content = {"study": study, "result": jsonable(result), "files": files}
    write_text(
        _file(folder, name), json.dumps(content | {"digest": _sum(content)}, indent=1) + "\n"
    )


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
        content = json.loads(path.read_text())
        signed = content.pop("digest")
        if signed != _sum(content):
            raise ValueError("edited since it was written")
        same, result, files = content["study"] == study, content["result"], content["files"]
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise ValueError(f"{path}: damaged ({error!r}); {remedy}") from error
    if not same:
        raise ValueError(f"{path}: of another study, {content['study']}; {remedy}")
    changed = [each for each, then in files.items() if digest(folder / each) != then]
    return dict(result), changed


def digest(path: Path) -> str | None:
    """SHA-256 of a file's content; None if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return None


def _file(folder: Path, name: str) -> Path:
    return folder / f"{name}.json"


def _sum(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
