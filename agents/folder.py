"""The folder of a training: its files, who may write to it, and which training it belongs to."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from trajopt.files import write_text
from trajopt.provenance import provenance

#: What a training leaves in its folder, besides TensorBoard's events.
NOTES, STATE = "train.json", "state.npz"
CLONE, BEST, LAST = "clone.zip", "best.zip", "last.zip"

#: The rounds of a cloning, until the training that goes on from it has a state.
CLONING = "cloning.npz"


@contextmanager
def sole_user(out: Path) -> Iterator[None]:
    """Make a folder if there is none, and lock it against other processes.

    The operating system releases the lock when this process ends, even if it is killed.

    Raises:
        ValueError: it is a file, or another process is using it.
        OSError: it cannot be written.
    """
    if out.exists() and not out.is_dir():
        raise ValueError(f"{out} is a file: choose a folder as --out")
    out.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(out / ".lock", timeout=0):
            yield
    except Timeout:
        raise ValueError(
            f"another process is working in {out}: wait until it ends, or choose another --out"
        ) from None


def claim(out: Path, identity: dict[str, Any]) -> None:
    """Make `out` the folder of a training, or check that it already is.

    Args:
        out: the folder; this process must be its sole user.
        identity: plain values that identify the training; they are written to train.json.

    Raises:
        ValueError: it holds another training, or policies of unknown origin.
        OSError: it cannot be written.
    """
    notes = out / NOTES
    if notes.exists():
        _require_same(notes, identity)
        return
    held = [name for name in (CLONE, BEST, LAST, STATE) if (out / name).exists()]
    if held:
        raise ValueError(
            f"{out} holds {' and '.join(held)} but no {NOTES}: move them away, or choose another "
            "--out"
        )
    write_text(notes, json.dumps(identity | provenance(), indent=1) + "\n")


def _require_same(notes: Path, identity: dict[str, Any]) -> None:
    try:
        has = json.loads(notes.read_bytes())
        if not isinstance(has, dict):
            raise TypeError(f"{type(has).__name__} instead of an object")
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise ValueError(
            f"{notes}: damaged ({error!r}), so its training cannot go on; start a new one from "
            f"{notes.with_name(BEST)} (--init), with another --out"
        ) from error
    for name, wanted in json.loads(json.dumps(identity)).items():
        if has.get(name) != wanted:
            old, new = _where_they_differ(has.get(name), wanted)
            raise ValueError(
                f"{notes.parent} holds a training with {name} = {old}, not {new}: go on with the "
                "same, or choose another --out"
            )


def _where_they_differ(one: Any, other: Any) -> tuple[Any, Any]:
    """Two values; of objects, only the entries that differ."""
    if not isinstance(one, dict) or not isinstance(other, dict):
        return one, other
    differing = [key for key in one | other if one.get(key) != other.get(key)]
    old, new = ({key: each[key] for key in differing if key in each} for each in (one, other))
    return old, new
