"""Nested values as JSON and arrays, which a file can hold without pickling."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rimless_gym.checks import extra

with extra("learn"):
    import torch

Arrays = dict[str, NDArray[Any]]


def to_arrays(tree: Any) -> tuple[Any, Arrays]:
    """A tree of values as JSON that refers to arrays by name, together with these arrays.

    Args:
        tree: of dictionaries, lists, tuples and deques; its leaves are numbers, text, None, NumPy
            arrays and torch tensors.

    Raises:
        TypeError: it holds a value of another type.
    """
    arrays: Arrays = {}
    return _flattened(tree, "tree", arrays), arrays


def from_arrays(plain: Any, arrays: Mapping[str, NDArray[Any]]) -> Any:
    """The tree that `to_arrays` took apart, with lists for tuples and deques.

    Raises:
        KeyError: an array is missing.
        ValueError: `plain` was not made by `to_arrays`.
    """
    if isinstance(plain, dict):
        if len(plain) != 1:
            raise ValueError(f"a node must have one kind, not {list(plain)}")
        [(kind, content)] = plain.items()
        match kind:
            case "array":
                return arrays[content]
            case "tensor":
                return torch.from_numpy(arrays[content].copy())
            case "dict":
                return {key: from_arrays(item, arrays) for key, item in content}
        raise ValueError(f"unknown kind of node {kind!r}")
    if isinstance(plain, list):
        return [from_arrays(item, arrays) for item in plain]
    return plain


def _flattened(tree: Any, name: str, arrays: Arrays) -> Any:
    match tree:
        case None | bool() | int() | float() | str():
            return tree
        case np.generic():
            return tree.item()
        case np.ndarray():
            arrays[name] = tree
            return {"array": name}
        case torch.Tensor():
            arrays[name] = tree.detach().cpu().numpy()
            return {"tensor": name}
        case Mapping():  # as pairs, because keys may be numbers
            items = [[key, _flattened(item, f"{name}.{key}", arrays)] for key, item in tree.items()]
            return {"dict": items}
        case list() | tuple() | deque():
            return [_flattened(item, f"{name}.{i}", arrays) for i, item in enumerate(tree)]
    raise TypeError(
        f"{name} is a {type(tree).__name__}: only plain values can be written to a file"
    )
