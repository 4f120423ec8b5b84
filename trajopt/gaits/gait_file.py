"""A gait's file: an .npz of plain arrays, everything else as JSON text, and a digest of both."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rimless_gym.checks import flag, integer, positive
from rimless_gym.params import WheelParams
from trajopt.files import read_arrays, require_names, write_arrays
from trajopt.gaits.gait_problem import MOST_TURNS
from trajopt.gaits.optimality import LocalOptimum, Optimality
from trajopt.gaits.verify import Verification
from trajopt.ocp.arrays import Array
from trajopt.ocp.trajectory import PhaseTrajectory, phases_from_arrays, phases_to_arrays

FORMAT = "rimless-gym gait 3"

REMEDY = "copy it again, or solve it again with `rimless gait`"

#: Entries of the header that are written as they are.
PLAIN = ("theta_turns", "regeneration", "provenance", "hold")


class GaitFileError(ValueError):
    """A file is not a gait that this version saved, or was edited or damaged since."""


def write_gait(path: str | Path, gait: Mapping[str, Any]) -> None:
    """Write the fields of a `trajopt.Solution`, by name."""
    header = {name: gait[name] for name in PLAIN} | {
        "params": gait["params"].to_dict(),
        "verification": gait["verification"].to_dict(),
        "optimality": dataclasses.asdict(gait["optimality"]),
        "optima": [dataclasses.asdict(optimum) for optimum in gait["optima"]],
    }
    write_arrays(path, FORMAT, header, phases_to_arrays(gait["phases"]))


def read_gait(path: str | Path) -> dict[str, Any]:
    """The fields that `write_gait` wrote, if the file has not changed since.

    Raises:
        FileNotFoundError: there is no such file.
        GaitFileError: it is not a gait saved by this version, or was edited or damaged.
    """
    header, arrays = read_arrays(path, FORMAT, GaitFileError, REMEDY)
    try:
        return _fields(header, arrays)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise GaitFileError(f"{path}: no valid gait ({error!r}); {REMEDY}") from error


def _fields(header: Mapping[str, Any], arrays: Mapping[str, Array]) -> dict[str, Any]:
    phases = phases_from_arrays(arrays)
    require_names(arrays, phases_to_arrays(phases))
    params = WheelParams(**header["params"])
    verification = Verification.from_dict(header["verification"])
    _require_stride(params, phases, verification)
    hold = header.get("hold")  # gaits saved by earlier versions have none
    if hold is not None:
        _require_held(positive("hold", hold), phases)
    return {
        "params": params,
        "phases": phases,
        "theta_turns": integer("theta_turns", header["theta_turns"], -MOST_TURNS, MOST_TURNS),
        "regeneration": flag("regeneration", header["regeneration"]),
        "verification": verification,
        "optimality": Optimality(**header["optimality"]),
        "optima": tuple(LocalOptimum(**optimum) for optimum in header["optima"]),
        "provenance": header["provenance"],
        "hold": hold,
    }


def _require_stride(
    params: WheelParams, phases: Sequence[PhaseTrajectory], verification: Verification
) -> None:
    """Refuse phases that are not a stride of the wheel, or not the stride that was verified."""
    for i, phase in enumerate(phases):
        sizes = phase.states.shape[-1], phase.controls.shape[-1]
        if sizes != (4, 1):
            raise ValueError(f"phase{i}: {sizes[0]} states and {sizes[1]} controls, not 4 and 1")
        if not np.array_equal(phase.control_nodes, phases[0].control_nodes):
            raise ValueError(f"phase{i}: its control_nodes differ from those of phase0")
        if not np.allclose(phase.states[1:, 0], phase.states[:-1, -1], rtol=0.0, atol=1e-6):
            raise ValueError(f"phase{i}: its states jump between elements")
    for name, own, verified in (
        ("time", sum(phase.duration for phase in phases), verification.time),
        ("distance", len(phases) * params.step_length, verification.distance),
    ):
        if not math.isclose(own, verified, rel_tol=1e-9):
            raise ValueError(f"its {name} is {own:g}, but {verified:g} was verified")


def _require_held(hold: float, phases: Sequence[PhaseTrajectory]) -> None:
    """Refuse phases whose voltage is not held over the periods of a clock."""
    ticks = sum(phase.duration for phase in phases) / hold
    if abs(ticks - round(ticks)) > 1e-6:
        raise ValueError(f"its stride lasts {ticks:g} periods of its clock, not a whole number")
    if any(phase.controls.shape[1] != 1 for phase in phases):
        raise ValueError("its voltage is not held")
