"""Trajectories as named arrays, the form in which files keep them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import NDArray

from trajopt.files import array_of
from trajopt.ocp.transcribe.trajectory import PhaseTrajectory

_FIELDS = tuple(field.name for field in dataclasses.fields(PhaseTrajectory))


def phases_to_arrays(
    phases: Sequence[PhaseTrajectory], prefix: str = ""
) -> dict[str, NDArray[Any]]:
    """The arrays of a trajectory by name: "phase0_edges" and so on, after the prefix."""
    return {
        f"{prefix}phase{i}_{name}": getattr(phase, name)
        for i, phase in enumerate(phases)
        for name in _FIELDS
    }


def phases_from_arrays(
    arrays: Mapping[str, NDArray[Any]], prefix: str = ""
) -> tuple[PhaseTrajectory, ...]:
    """The trajectory in arrays that `phases_to_arrays` named.

    Raises:
        ValueError: there is none, or one of its arrays is missing, does not fit the others, or has
            numbers that are not finite floating-point numbers or not in order.
    """
    count = 0
    while f"{prefix}phase{count}_edges" in arrays:
        count += 1
    if not count:
        raise ValueError("it has no phases")
    return tuple(_phase_from_arrays(arrays, f"{prefix}phase{i}_") for i in range(count))


def _phase_from_arrays(arrays: Mapping[str, NDArray[Any]], prefix: str) -> PhaseTrajectory:
    own = [array_of(arrays, prefix + name) for name in _FIELDS]
    try:
        trajectory = PhaseTrajectory(*own)
    except ValueError as error:
        raise ValueError(f"{prefix}{error}") from None
    trajectory.require_sound(prefix.removesuffix("_"))
    return trajectory
