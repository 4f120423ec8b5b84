"""Options that commands share: how they are written, and which values they refuse.

Each is a type for the signature of a command, `def gait(*, speed: Positive = 0.62) -> int`. What a
value depends on (a machine, a file) is checked when the command runs.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg
from tyro.constructors import PrimitiveConstructorSpec

if TYPE_CHECKING:
    from rimless_gym.params import WheelParams

#: What stands before the value of a field, in key=value.
FIELD = re.compile(r"([A-Za-z_][\w.]*)=")


def whole(least: int, most: int | None = None) -> Callable[[str], int]:
    """Reads an integer from `least` to `most`, such as 20 or 2e7."""
    limits = f"of at least {least}" + ("" if most is None else f" and at most {most}")

    def read(text: str) -> int:
        try:
            number = int(text) if "e" not in text else float(text)
        except ValueError:
            number = math.nan
        if not (number >= least and (most is None or number <= most) and number % 1 == 0):
            raise ValueError(f"{text!r}: must be an integer {limits}")
        return int(number)

    return read


def positive(text: str) -> float:
    """Reads a finite number greater than 0."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 < number < math.inf:
        raise ValueError(f"{text!r}: must be a number greater than 0")
    return number


def fields(text: str) -> dict[str, Any]:
    """Reads fields from a JSON object, a file that holds one, or from key=value, one a line.

    Dots lead into objects (pushes.rate=0.5). Values are JSON, or else texts.
    """
    if FIELD.match(text):
        values: dict[str, Any] = {}
        for line in text.splitlines():
            path, _, value = line.partition("=")
            *outer, name = path.split(".")
            place = values
            for each in outer:
                place = place.setdefault(each, {})
            place[name] = _json(value, value)
        return values
    found = _json(Path(text).read_text() if text.endswith(".json") else text, None)
    if not isinstance(found, dict):
        raise ValueError(f"{text[:200]!r}: must be a JSON object {{...}}, or key=value")
    return found


def _json(text: str, otherwise: Any) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return otherwise


def joined_fields(arguments: Sequence[str]) -> list[str]:
    """Arguments in which key=value that follow each other are one argument, as `fields` reads."""
    joined: list[str] = []
    for each in arguments:
        if joined and FIELD.match(each) and FIELD.match(joined[-1]):
            joined[-1] += f"\n{each}"
        else:
            joined.append(each)
    return joined


def _written(default: Any) -> list[str]:
    """A default as it would be typed."""
    if isinstance(default, tuple):
        return [str(each) for each in default]
    return [] if default is None else [str(default)]


def several(
    metavar: str, read: Callable[[str], Any], nargs: int | Literal["*"]
) -> PrimitiveConstructorSpec[Any]:
    """An option of several values, as many as `nargs`."""
    return PrimitiveConstructorSpec(
        nargs=nargs,
        metavar=metavar,
        instance_from_str=lambda texts: tuple(map(read, texts)),
        is_instance=lambda value: True,
        str_from_instance=_written,
    )


def one(metavar: str, read: Callable[[str], Any]) -> PrimitiveConstructorSpec[Any]:
    """An option of one value."""
    spec = several(metavar, read, 1)
    return dataclasses.replace(spec, instance_from_str=lambda texts: read(*texts))


#: For options whose description names the default, or that have none.
NO_DEFAULT = arg(help_behavior_hint="")

Flag = Annotated[bool, NO_DEFAULT]
Whole = Annotated[int, one("INT", whole(0))]
Count = Annotated[int, one("INT", whole(1))]
Positive = Annotated[float, one("NUMBER", positive)]
MaybeCount = Annotated[int | None, one("INT", whole(1)), NO_DEFAULT]
MaybeWhole = Annotated[int | None, one("INT", whole(0)), NO_DEFAULT]
MaybePositive = Annotated[float | None, one("NUMBER", positive), NO_DEFAULT]
MaybeAddress = Annotated[str | None, one("ADDRESS", str), NO_DEFAULT]
MaybePath = Annotated[Path | None, one("PATH", Path), NO_DEFAULT]

#: Two numbers, the lesser first.
Range = Annotated[tuple[float, float], several("LEAST GREATEST", positive, 2)]
MaybeRange = Annotated[
    tuple[float, float] | None, several("LEAST GREATEST", positive, 2), NO_DEFAULT
]
Positives = Annotated[tuple[float, ...], several("NUMBER ...", positive, "*")]
MaybePositives = Annotated[tuple[float, ...], several("NUMBER ...", positive, "*"), NO_DEFAULT]

#: Names without an option before them.
Names = Annotated[Positional[tuple[str, ...]], several("NAME ...", str, "*"), NO_DEFAULT]

#: Names after an option.
Several = Annotated[tuple[str, ...], several("NAME ...", str, "*"), NO_DEFAULT]

#: Fields of an object; see `fields`.
Fields = Annotated[dict[str, Any] | None, one("JSON | KEY=VALUE ...", fields), NO_DEFAULT]

Preset = Literal["BUILDABLE", "PROTOTYPE", "THESIS_NOMINAL", "THESIS_PHYSICAL"]
MaybePreset = Annotated[Preset | None, one("NAME", str), NO_DEFAULT]


def machine(preset: str | None, params: dict[str, Any] | None) -> WheelParams:
    """The machine that options choose: a preset, by default the environment's, with changes."""
    from rimless_gym import presets

    return presets.preset(preset or "BUILDABLE").replace(**(params or {}))


def chosen(names: Sequence[str], known: Sequence[str]) -> list[str]:
    """The names that are given, all that are known if there are none; refuses unknown ones."""
    if unknown := [name for name in names if name not in known]:
        raise ValueError(f"{', '.join(unknown)}: unknown; choose from {', '.join(known)}")
    return list(names or known)


def require_folder(folder: Path) -> None:
    """Make a folder where it is missing; refuse one in which no file can be made."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass


def require_file(path: Path) -> None:
    """Make a file's folder; refuse a file that cannot be written, before the work is done."""
    if path.is_dir():
        raise ValueError(f"{path}: is a folder; give the name of a file")
    require_folder(path.parent)
