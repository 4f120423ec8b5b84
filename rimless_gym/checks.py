"""Checks of arguments: each returns the checked value, or raises an error.

That is a `KindError` for a value of the wrong type and a `ValueError` for one out of its range; it
names the argument, its value and what it must be.
"""

from __future__ import annotations

import dataclasses
import math
import operator
import reprlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: The largest magnitude of a number, and the smallest of a divisor. Results computed from several
#: such numbers stay finite, and no real machine comes near either limit.
LARGEST, SMALLEST = 1e30, 1e-30


class KindError(TypeError):
    """An argument is of the wrong type."""


def real(name: str, value: Any) -> float:
    """The number `value`."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise KindError(f"{name} = {value!r}: must be a real number")
    try:
        number = float(value)
    except OverflowError:  # an integer of hundreds of digits
        number = math.inf
    if not abs(number) <= LARGEST:
        raise ValueError(f"{name} = {number}: must be finite, and at most {LARGEST:g} in size")
    return number


def positive(name: str, value: Any) -> float:
    """The real number `value`, greater than 0."""
    number = real(name, value)
    if not number > 0.0:
        raise ValueError(f"{name} = {number}: must be greater than 0")
    return number


def not_negative(name: str, value: Any) -> float:
    """The real number `value`, at least 0."""
    number = real(name, value)
    if number < 0.0:
        raise ValueError(f"{name} = {number}: must be at least 0")
    return number


def flag(name: str, value: Any) -> bool:
    """The truth value `value`, Python's or NumPy's."""
    if not isinstance(value, (bool, np.bool_)):
        raise KindError(f"{name} = {value!r}: must be True or False")
    return bool(value)


def require_kind(name: str, value: Any, kind: type) -> None:
    """Refuse a value that is not a `kind`."""
    if not isinstance(value, kind):
        module = kind.__module__.split(".")[0]
        raise KindError(f"{name} = {value!r}: must be a {module}.{kind.__name__}")


def require_callable(name: str, value: Any) -> None:
    """Refuse a value that cannot be called."""
    if not callable(value):
        raise KindError(f"{name} = {reprlib.repr(value)}: must be a function")


def integer(name: str, value: Any, least: int, most: int | None = None) -> int:
    """The integer `value`: Python's, NumPy's or an array of shape ()."""
    wanted = f"must be an integer of at least {least}"
    if most is not None:
        wanted += f" and at most {most}"
    if isinstance(value, (bool, np.bool_)):
        raise KindError(f"{name} = {value!r}: {wanted}")
    try:
        number = operator.index(value)
    except TypeError:
        raise KindError(f"{name} = {value!r}: {wanted}") from None
    if number < least or (most is not None and number > most):
        raise ValueError(f"{name} = {number}: {wanted}")
    return number


def real_array(name: str, values: Any) -> NDArray[Any]:
    """Real numbers as an array; an array is returned as it is, not copied."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise ValueError(f"{name} = {values!r}: must be in rows of one length") from None
    if array.dtype.kind not in "biuf":
        raise KindError(f"{name} = {values!r}: must be real numbers, not {array.dtype}")
    return array


def as_instance(kind: type[Any], name: str, value: Any, default: Any) -> Any:
    """`value` as the dataclass `kind`, or from a mapping of its fields; the default for None."""
    if value is None or isinstance(value, kind):
        return default if value is None else value
    if not isinstance(value, Mapping):
        raise KindError(
            f"{name} = {value!r}: give a rimless_gym.{kind.__name__} or a dictionary of its fields"
        )
    known = [field.name for field in dataclasses.fields(kind)]
    for field in value:
        if field not in known:
            raise ValueError(
                f"{name}: {field!r} is not a field of {kind.__name__}: choose from {known}"
            )
    fields = dataclasses.fields(kind)
    needed = [f.name for f in fields if f.default is f.default_factory is dataclasses.MISSING]
    if missing := [field for field in needed if field not in value]:
        raise ValueError(f"{name} = {value!r}: lacks {missing}")
    return kind(**value)


class MissingExtraError(ImportError):
    """A package that comes with an extra of rimless-gym is not installed."""


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Imports of packages that come with an extra: its name in pyproject.toml, such as "learn".

    Where one is missing, a `MissingExtraError` names it and its installation.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"{error.name} is not installed: it comes with pip install 'rimless-gym[{name}]', or "
            f"in a checkout with pip install -e '.[{name}]'",
            name=error.name,
        ) from error
