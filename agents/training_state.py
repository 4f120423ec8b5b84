"""The full state of a training in a file, from which it goes on after being killed at any time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from agents.trees import from_arrays, to_arrays
from trajopt.files import read_arrays, write_arrays

FORMAT = "rimless-gym training 3"

_REMEDY = "delete it to begin this training anew, or choose another --out"


class StateError(ValueError):
    """A state is damaged, or does not fit the training that is to go on."""


def write_state(path: Path, state: dict[str, Any]) -> None:
    """Write a tree of values, see `agents.trees`; the file is complete or left as it was.

    Raises:
        OSError: the disk is full, or the folder cannot be written; the last state is kept.
    """
    plain, arrays = to_arrays(state)
    write_arrays(path, FORMAT, {"tree": plain}, arrays)


def read_state(path: Path) -> dict[str, Any]:
    """What `write_state` wrote.

    Raises:
        StateError: the file is damaged.
    """
    header, arrays = read_arrays(path, FORMAT, StateError, _REMEDY)
    try:
        return dict(from_arrays(header["tree"], arrays))
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise StateError(f"{path}: damaged ({error!r}); {_REMEDY}") from error
