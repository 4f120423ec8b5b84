"""Finished work in files: a store of results by key, and the file formats that it is made of.

Every file is complete or not there, whatever ends the process. Reading one executes nothing. A
digest shows whether a file was edited or damaged; it does not show who wrote it. `provenance` is
what made a result. A process asks for it once: git takes a tenth of a second to answer.
"""

from __future__ import annotations

import dataclasses
import functools
import glob
import hashlib
import importlib.metadata
import json
import math
import os
import platform
import re
import subprocess
import time
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
from numpy.typing import NDArray

#: Entries of an archive besides its arrays.
HEADER, DIGEST = "header", "digest"

#: The format of a store's arrays.
ARRAYS = "rimless-gym arrays 1"

#: Most bytes that the arrays of a file from elsewhere may take, a hundred times what they do.
MOST_BYTES = 2**28

#: Seconds after which an unfinished file counts as abandoned by a killed process.
ABANDONED = 3600.0


class Store:
    """Finished work in a folder: the result of each task under a key.

    This loop continues after a kill where it ended:

        with Store(folder, {"seed": seed}) as store:
            for task, result in run(work, [t for t in tasks if t.key not in store]):
                store.save(task.key, result)

    Entering the store locks the folder; the operating system releases the lock, however the process
    ends. A folder that is locked, or holds results of other or unknown inputs, is a ValueError.
    Without entering, results can be loaded, and saved beside those of other processes.

    Args:
        folder: is made where it is missing.
        inputs: JSON values that all results in the folder depend on. What one result depends on in
            addition belongs into its `key`.
        record: name of the file that holds `inputs` and the versions of the software.
    """

    def __init__(
        self,
        folder: str | Path,
        inputs: Mapping[str, Any] | None = None,
        record: str = "inputs.json",
    ) -> None:
        self.folder = Path(folder)
        self._inputs = {} if inputs is None else jsonable(inputs)
        self._record = self.folder / record

    def __enter__(self) -> Self:
        from filelock import FileLock, Timeout

        self.folder.mkdir(parents=True, exist_ok=True)
        self._lock = FileLock(self.folder / ".lock", timeout=0)
        try:
            self._lock.acquire()
            self.check()
            if self._inputs and not self._record.exists():
                text = json.dumps({"inputs": self._inputs, **provenance()}, indent=1)
                write_text(self._record, text + "\n")
        except Timeout:
            raise ValueError(
                f"another process is working in {self.folder}: wait until it ends, or choose "
                "another folder"
            ) from None
        except BaseException:
            self._lock.release()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self._lock.release()

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs; the lock stays here."""
        return {name: value for name, value in self.__dict__.items() if name != "_lock"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Refuse a computer that does not have the folder."""
        self.__dict__.update(state)
        require_shared(self.folder)

    def __contains__(self, key: str) -> bool:
        """Whether there is a result that is undamaged and whose files are unchanged."""
        return self._read(key) is not None

    def load(self, key: str) -> Any:
        """The result that was saved, or a KeyError; tuples come back as lists."""
        content, arrays = self._read(key), dict[str, NDArray[Any]]()
        if content is None:
            raise KeyError(f"{self.folder / key}: no result, or changed since it was saved")
        if f"{key}.npz" in content["files"]:
            path, most = self._path(key, "npz"), math.inf  # written here, and of any size
            _, arrays = read_arrays(path, ARRAYS, ValueError, "compute it again", most)
        return joined(content["value"], arrays)

    def save(self, key: str, value: Any, files: Iterable[str | Path] = ()) -> None:
        """Keep a result.

        Args:
            key: name of its file, without suffix; it may stand in a subfolder, "ppo/seed3".
            value: JSON values, and arrays among them.
            files: other files of the result, relative to the folder; where one of them is changed
                or missing, the result no longer counts.
        """
        arrays: dict[str, NDArray[Any]] = {}
        tree, parts = split(value, arrays), [str(each) for each in files]
        self._path(key, "json").parent.mkdir(parents=True, exist_ok=True)
        if arrays:
            write_arrays(self._path(key, "npz"), ARRAYS, {}, arrays)
            parts.append(f"{key}.npz")
        digests = {each: file_digest(self.folder / each) for each in parts}
        if missing := [each for each, known in digests.items() if known is None]:
            raise FileNotFoundError(f"{self.folder}: no file {', '.join(missing)} to keep")
        content = {"value": tree, "files": digests}
        text = json.dumps(content | {DIGEST: _signature(content)}, indent=1)
        write_text(self._path(key, "json"), text + "\n")

    def check(self) -> None:
        """Refuse a folder that holds results of other or unknown inputs with a ValueError."""
        inputs = json.loads(json.dumps(self._inputs))
        if not self._record.exists():
            if inputs and any(path.stem in self for path in self.folder.glob("*.json")):
                raise ValueError(
                    f"{self.folder} holds results but no {self._record.name}, so that their inputs "
                    "are unknown: choose another folder"
                )
            return
        try:
            known = dict(json.loads(self._record.read_bytes())["inputs"])
        except (ValueError, TypeError, KeyError, RecursionError) as error:
            raise ValueError(
                f"{self._record}: damaged ({error!r}); choose another folder"
            ) from error
        for name in inputs | known:
            if known.get(name) != inputs.get(name):
                old, new = _difference(known.get(name), inputs.get(name))
                raise ValueError(
                    f"{self.folder} holds results of {name} = {old}, not {new}: use the same, or "
                    "choose another folder"
                )

    def _read(self, key: str) -> dict[str, Any] | None:
        """What the file of a key holds; None where it is missing, or it or a file was changed."""
        try:
            content = dict(json.loads(self._path(key, "json").read_text()))
            signed = content.pop(DIGEST) == _signature(content)
            files = content["files"].items()
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
            return None
        same = all(file_digest(self.folder / name) == digest for name, digest in files)
        return content if signed and same else None

    def _path(self, key: str, suffix: str) -> Path:
        return self.folder / f"{key}.{suffix}"


def require_shared(folder: Path) -> None:
    """Refuse, on a worker of a cluster, a folder that only the command's computer has."""
    if not folder.is_dir():
        raise FileNotFoundError(
            f"{folder.absolute()}: no such folder on the worker {platform.node()}: choose one on a "
            "file system that all workers share"
        )


def key(name: str, **inputs: Any) -> str:
    """A key: a name for people, and a digest of the JSON values, arrays and dataclasses given."""
    return re.sub(r"[^\w.+-]+", "_", name) + "-" + _signature(jsonable(inputs))[:12]


def file_digest(path: Path) -> str | None:
    """SHA-256 of a file's content; None where it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return None


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file's content; an existing file is replaced as a whole, or stays as it is."""
    with _replacing(path) as file:
        file.write(content)


def write_text(path: Path, text: str) -> None:
    """Write a text, as `write_bytes`."""
    write_bytes(path, text.encode())


def write_arrays(
    path: str | Path, form: str, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write an .npz file of arrays, a header of JSON values and a digest, as `write_bytes`.

    `form` states what the file is, and the version of its format.
    """
    text = np.array(json.dumps({"format": form, **header}))
    entries: dict[str, Any] = {**arrays, HEADER: text}
    entries[DIGEST] = np.array(digest(entries))
    with _replacing(Path(path)) as file:
        np.savez_compressed(file, **entries)


def read_arrays(
    path: str | Path | IO[bytes],
    form: str,
    error: type[Exception],
    remedy: str,
    most: float = MOST_BYTES,
) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The header and the arrays that `write_arrays` wrote, of a file or an open file.

    Raises:
        FileNotFoundError: there is no such file.
        Exception: `error`, with `remedy`, if it is of another format, was edited or damaged, or
            would take more than `most` bytes in memory.
    """
    if isinstance(path, str | Path) and not Path(path).is_file():
        raise FileNotFoundError(f"{path}: no such file")
    if isinstance(path, str | Path) and not zipfile.is_zipfile(path):
        raise error(f"{path}: damaged, or not a file of format {form!r}; {remedy}")
    try:
        source = Path(path).open("rb") if isinstance(path, str | Path) else path  # noqa: SIM115
        with source as file, np.load(file, allow_pickle=False) as data:
            size = sum(entry.file_size for entry in data.zip.infolist())  # before any is read
            if size > most:
                raise ValueError(f"{size} bytes of arrays, and at most {most} are read")
            arrays = {name: data[name] for name in data.files}
        header = json.loads(str(arrays[HEADER]))
        written = header.pop("format")
    except Exception as cause:  # a damaged archive raises almost anything
        raise error(
            f"{path}: damaged, or not a file of format {form!r} ({cause!r}); {remedy}"
        ) from cause
    if written != form:
        raise error(f"{path}: format {written!r}, but {form!r} is needed here; {remedy}")
    if str(arrays.pop(DIGEST, None)) != digest(arrays):
        raise error(f"{path}: edited or damaged since it was saved (wrong digest); {remedy}")
    del arrays[HEADER]
    return header, arrays


def digest(arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 over names, types, shapes and contents of arrays, the header's text included."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def jsonable(value: Any) -> Any:
    """A value as strict JSON: dataclasses become objects, arrays lists, infinities and NaN null."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = dataclasses.asdict(value)
    if isinstance(value, Mapping):
        return {name: jsonable(item) for name, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return jsonable(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [jsonable(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def split(value: Any, arrays: dict[str, NDArray[Any]]) -> Any:
    """A value with references in place of its arrays, which are added to `arrays`."""
    if isinstance(value, Mapping):
        return {name: split(item, arrays) for name, item in value.items()}
    if isinstance(value, np.ndarray):
        name = f"array{len(arrays)}"
        arrays[name] = value
        return {"__array__": name}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [split(item, arrays) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def joined(tree: Any, arrays: Mapping[str, NDArray[Any]]) -> Any:
    """The value that `split` took apart."""
    if isinstance(tree, dict):
        if tree.keys() == {"__array__"}:
            return arrays[tree["__array__"]]
        return {name: joined(item, arrays) for name, item in tree.items()}
    return [joined(item, arrays) for item in tree] if isinstance(tree, list) else tree


def provenance(**settings: Any) -> dict[str, Any]:
    """Versions of what computes, the git revision where there is one, and `settings`."""
    return {"versions": dict(_versions()), "git_revision": _git_revision(), **settings}


def _signature(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _difference(old: Any, new: Any) -> tuple[Any, Any]:
    """Two values; of objects, only the entries that differ."""
    if not isinstance(old, dict) or not isinstance(new, dict):
        return old, new
    names = [name for name in old | new if old.get(name) != new.get(name)]
    return {n: old[n] for n in names if n in old}, {n: new[n] for n in names if n in new}


@contextmanager
def _replacing(path: Path) -> Iterator[IO[bytes]]:
    """A new file that replaces `path` once it is complete.

    Each process has its own part: several may write the same file into a folder that they share.
    """
    for part in path.parent.glob(f"{glob.escape(path.name)}.*.part"):
        with suppress(OSError):  # another process may remove it, too
            if time.time() - part.stat().st_mtime > ABANDONED:
                part.unlink()
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with part.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())  # or a power cut could leave an empty file
        os.replace(part, path)
    except BaseException as error:  # a full disk or Ctrl-C, perhaps: the part must not stay
        with suppress(OSError):
            part.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


@functools.cache
def _versions() -> dict[str, str]:
    versions = {}
    for name in ("rimless-gym", "casadi", "numba", "numpy", "scipy"):
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions


@functools.cache
def _git_revision() -> str | None:
    command = ["git", "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        run = subprocess.run(
            command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=5
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return run.stdout.strip() or None
