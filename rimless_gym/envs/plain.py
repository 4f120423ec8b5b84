"""Arguments as plain JSON values and back: an environment can be remade from its `spec` as text."""

from __future__ import annotations

import copy
import dataclasses
import enum
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from gymnasium.envs.registration import EnvSpec

T = TypeVar("T")


def plain(value: Any) -> Any:
    """The value in JSON's types; a value that has no such form is returned unchanged."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return plain(dataclasses.asdict(value))
    if isinstance(value, enum.Enum):
        return plain(value.value)
    if isinstance(value, (np.generic, np.ndarray)):
        return plain(value.tolist())
    if isinstance(value, Mapping):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return [plain(each) for each in value]
    return value


def made_of(kind: type[T], name: str, fields: Mapping[str, Any]) -> T:
    """An instance of the dataclass `kind` with these fields; errors call it `name`.

    Raises:
        TypeError: a field has the wrong type, or is missing.
        ValueError: there is no such field, or its value is out of range.
    """
    known = [field.name for field in dataclasses.fields(kind)]  # type: ignore[arg-type]
    for field in fields:
        if field not in known:
            raise ValueError(
                f"{name}: {field!r} is not a field of {kind.__name__}: choose from {known}"
            )
    missing = [
        field.name
        for field in dataclasses.fields(kind)  # type: ignore[arg-type]
        if field.name not in fields
        and field.default is dataclasses.MISSING
        and field.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise TypeError(f"{name}: give its {' and '.join(missing)} as well ({kind.__name__})")
    return kind(**fields)


def _get(env: Any) -> EnvSpec | None:
    return getattr(env, "_spec", None)


def _set(env: Any, spec: EnvSpec | None) -> None:
    if spec is not None:
        spec = copy.copy(spec)
        spec.kwargs = plain(spec.kwargs)
    env._spec = spec  # as an attribute: using __dict__ would slow down every other attribute


#: A property for environments: the `spec` that Gymnasium sets, with arguments as JSON values.
plain_spec = property(_get, _set)
