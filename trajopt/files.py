"""Results in files: .npz archives of plain arrays, a JSON header and a digest of both.

Reading a file executes nothing. The digest shows whether the file was edited or damaged; it does
not show who wrote it.
"""

from __future__ import annotations

import glob
import hashlib
import json
import math
import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

#: Entries of a file besides its arrays.
HEADER, DIGEST = "header", "digest"

#: Seconds after which an unfinished file is taken for one that a killed process has left.
ABANDONED = 3600.0


def write_arrays(
    path: str | Path, form: str, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write arrays and a header of JSON values; an existing file is replaced as a whole.

    Args:
        path: of the file, .npz.
        form: what the file is, and the version of its format.
        header: everything that is not an array.
        arrays: by name, neither `HEADER` nor `DIGEST`.

    Raises:
        OSError: the disk is full, or the folder cannot be written; an existing file is kept.
    """
    text = np.array(json.dumps({"format": form, **header}))
    entries: dict[str, Any] = {**arrays, HEADER: text}
    entries[DIGEST] = np.array(digest(entries))
    with _replacing(Path(path)) as file:
        np.savez_compressed(file, **entries)


def write_text(path: Path, text: str) -> None:
    """Write a text; an existing file is replaced as a whole.

    Raises:
        OSError: the disk is full, or the folder cannot be written; an existing file is kept.
    """
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file's content; an existing file is replaced as a whole.

    Raises:
        OSError: the disk is full, or the folder cannot be written; an existing file is kept.
    """
    with _replacing(path) as file:
        file.write(content)


def part_of(path: Path) -> Path:
    """The file that holds what is to be written to another one until it is complete.

    Each process has its own: some write the same gait into a folder that they share.
    """
    return path.with_name(f"{path.name}.{os.getpid()}.part")


@contextmanager
def _replacing(path: Path) -> Iterator[IO[bytes]]:
    """A new file that replaces `path` once it is complete.

    What killed processes have left of it is removed first.
    """
    _sweep(path)
    unfinished = part_of(path)
    try:
        with unfinished.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())  # or a power cut could leave an empty file
        os.replace(unfinished, path)
    except BaseException as error:  # a full disk or Ctrl-C, perhaps: the part must not stay
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def _sweep(path: Path) -> None:
    """Remove what killed processes have left of a file that they were writing."""
    for left in path.parent.glob(f"{glob.escape(path.name)}.*.part"):
        with suppress(OSError):  # another process may remove it, too
            if time.time() - left.stat().st_mtime > ABANDONED:
                left.unlink()


def read_arrays(
    path: str | Path | IO[bytes], form: str, error: type[Exception], remedy: str
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The header and the arrays that `write_arrays` wrote, if they have not changed since.

    Args:
        path: of the file, or the open file.
        form: the format that it must have.
        error: the exception to raise if it has another, or was edited or damaged.
        remedy: what to do then, for the message.

    Raises:
        FileNotFoundError: there is no such file.
        Exception: `error`, see above.
    """
    if isinstance(path, str | Path) and not Path(path).is_file():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        source = Path(path).open("rb") if isinstance(path, str | Path) else path  # noqa: SIM115
        with source as file, np.load(file, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
        foreign = [name for name, array in arrays.items() if not isinstance(array, np.ndarray)]
        if foreign:  # numpy returns entries whose name does not end with .npy as bytes
            raise ValueError(f"{foreign} are no arrays")
        header = json.loads(str(arrays[HEADER]))
        found = header.pop("format")
    except Exception as cause:  # a damaged archive raises almost anything
        raise error(
            f"{path}: damaged, or not a file of format {form!r} ({cause!r}); {remedy}"
        ) from cause
    if found != form:
        raise error(f"{path}: format {found!r}, but {form!r} is needed here; {remedy}")
    if str(arrays.pop(DIGEST, None)) != digest(arrays):
        raise error(
            f"{path}: edited or damaged since it was saved: its digest does not match, and its "
            f"figures cannot be trusted; {remedy}"
        )
    del arrays[HEADER]
    return header, arrays


def write_signed(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON values with a digest of them; an existing file is replaced as a whole.

    Raises:
        OSError: the disk is full, or the folder cannot be written; an existing file is kept.
    """
    plain = jsonable(content)
    write_text(path, json.dumps(plain | {DIGEST: _signature(plain)}, indent=1) + "\n")


def read_signed(path: Path) -> dict[str, Any]:
    """The values that `write_signed` wrote, if they have not changed since.

    Raises:
        ValueError: the file was edited or damaged.
        OSError: it cannot be read.
    """
    try:
        content = json.loads(path.read_text())
        if content.pop(DIGEST) != _signature(content):
            raise ValueError("edited since it was written")
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise ValueError(f"{path}: damaged ({error!r})") from error
    return dict(content)


def _signature(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def digest(arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over names, types, shapes and contents of arrays, the header's text included."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def array_of(
    arrays: Mapping[str, NDArray[Any]], name: str, shape: tuple[int, ...] | None = None
) -> NDArray[np.float64]:
    """A file's array by name, which must be float64 and, where one is given, of this shape.

    Raises:
        ValueError: it is missing, or of another type or shape.
    """
    if name not in arrays:
        raise ValueError(f"{name} is missing")
    array = arrays[name]
    if array.dtype != np.float64:
        raise ValueError(f"{name} is of type {array.dtype}, not float64")
    if shape is not None and array.shape != shape:
        raise ValueError(f"{name} is of shape {array.shape}, not {shape}")
    return array


def require_names(arrays: Mapping[str, NDArray[Any]], expected: Iterable[str]) -> None:
    """Refuse arrays that are not `expected` in a file of this kind.

    Raises:
        ValueError: there is an array of another name.
    """
    unknown = sorted(set(arrays) - set(expected))
    if unknown:
        raise ValueError(f"{', '.join(unknown)}: no such arrays are known")


def jsonable(value: Any) -> Any:
    """Values as strict JSON: arrays and tuples as lists, infinities and NaN as null."""
    if isinstance(value, Mapping):
        return {key: jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return jsonable(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [jsonable(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
