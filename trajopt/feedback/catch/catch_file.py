"""The times of a planned catch in a file, so that other processes need not plan it again."""

from __future__ import annotations

from pathlib import Path

from trajopt.feedback.catch.grid import Values
from trajopt.files import array_of, read_arrays, write_arrays

FORMAT = "rimless-gym catch 1"

_REMEDY = "delete it to plan the catch again"


def write_times(path: Path, times: Values) -> None:
    """Write them; the file is complete or not there.

    Raises:
        OSError: the disk is full, or the folder cannot be written.
    """
    write_arrays(path, FORMAT, {}, times._asdict())


def read_times(path: Path, counts: tuple[int, ...]) -> Values:
    """What `write_times` wrote, for a grid of so many nodes.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is damaged, or for another grid.
    """
    _, arrays = read_arrays(path, FORMAT, ValueError, _REMEDY)
    try:
        return Values(
            array_of(arrays, "single", counts),
            array_of(arrays, "double", (counts[1], counts[3])),
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}; {_REMEDY}") from error
